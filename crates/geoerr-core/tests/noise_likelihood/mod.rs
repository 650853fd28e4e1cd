//! The likelihood of noise against dense matrices, against differences, and against itself.

#![allow(clippy::unwrap_used, clippy::panic, reason = "that is how a test fails")]

mod scene;
mod searching;
mod values;
mod whitening;
