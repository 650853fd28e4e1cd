//! The likelihood of noise against dense matrices, against differences, and against itself.

mod draws;
mod scene;
mod searching;
mod values;
mod whitening;
