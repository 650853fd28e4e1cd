//! The hot paths of the core, one at a time and so many times over, for a tool that counts instructions.
//!
//! `target/release/instructions` lists them; `target/release/instructions PATH TIMES` runs one, on one thread. What one run
//! takes is the difference of two counts: so nothing that prepares it is counted. `python benches/python/instructions.py`
//! counts them all and compares them with what was recorded.

use std::error::Error;
use std::hint::black_box;

use geoerr_bench::gcode::{bent, rewrite, walls};
use geoerr_bench::kinematics::{machine, rows};
use geoerr_bench::least_squares::{random, sparse};
use geoerr_bench::lines::{POINTS_OF_A_LINE, points};
use geoerr_bench::straightness::{positions_mm, slopes_rad};
use geoerr_bench::triangulation::{pixels, projections};
use geoerr_core::least_squares::{Method, Options, StoredDesign, fit};
use geoerr_core::line::{PointNoise, fit_lines};
use geoerr_core::newton::commands_for;
use geoerr_core::straightness::{Rule, integrate_straightness};
use geoerr_core::triangulate::{PixelNoise, Pixels, Rig, Status, triangulate, triangulate_points};

type Outcome = Result<(), Box<dyn Error>>;

/// Runs a path so many times.
type Path = fn(usize) -> Outcome;

const PATHS: [(&str, Path); 9] = [
    ("triangulation-points", triangulation_points),
    ("triangulation-covariances", triangulation_covariances),
    ("lines", lines),
    ("straightness-trapezoid", |times| straightness(Rule::Trapezoid, times)),
    ("straightness-simpson", |times| straightness(Rule::Simpson, times)),
    ("commands", commands),
    ("gcode-short-moves", |times| gcode(1.0, 20_000, times)),
    ("gcode-long-moves", |times| gcode(50.0, 4_000, times)),
    ("least-squares", least_squares),
];

fn triangulation_points(times: usize) -> Outcome {
    const N_POINTS: usize = 100_000;
    let [left, right] = projections();
    let rig = Rig::new(&left, &right)?;
    let [left, right] = [left, right].map(|projection| pixels(&projection, N_POINTS));
    let (mut points_mm, mut status) = (vec![[0.0; 3]; N_POINTS], vec![Status::Ok; N_POINTS]);
    for _ in 0..times {
        triangulate_points(&rig, black_box(&left), black_box(&right), &mut points_mm, &mut status)?;
    }
    Ok(())
}

fn triangulation_covariances(times: usize) -> Outcome {
    let [left, right] = projections();
    let rig = Rig::new(&left, &right)?;
    let [left, right] = [left, right].map(|projection| pixels(&projection, 50_000));
    let [left, right] = [&left, &right].map(|uv_px| Pixels { uv_px, noise: PixelNoise::Sigma(0.1) });
    for _ in 0..times {
        black_box(triangulate(&rig, black_box(&left), black_box(&right), 0)?);
    }
    Ok(())
}

fn lines(times: usize) -> Outcome {
    let points = points(5_000);
    let starts: Vec<usize> = (0..5_000).map(|line| line * POINTS_OF_A_LINE).collect();
    for _ in 0..times {
        black_box(fit_lines(black_box(&points), &starts, PointNoise::FromResiduals)?);
    }
    Ok(())
}

fn straightness(rule: Rule, times: usize) -> Outcome {
    let (positions, slopes) = (positions_mm(), slopes_rad(10_000));
    for _ in 0..times {
        black_box(integrate_straightness(black_box(&positions), black_box(&slopes), rule)?);
    }
    Ok(())
}

fn commands(times: usize) -> Outcome {
    let (machine, rows) = (machine(), rows(5_000));
    for _ in 0..times {
        black_box(commands_for(&machine, black_box(&rows), 1e-6)?);
    }
    Ok(())
}

fn gcode(step_mm: f64, n_moves: u32, times: usize) -> Outcome {
    let (machine, program) = (bent("tables"), walls(n_moves, step_mm));
    for _ in 0..times {
        black_box(rewrite(&machine, black_box(&program)));
    }
    Ok(())
}

fn least_squares(times: usize) -> Outcome {
    for (design, method) in [
        (random(3_000, 60), Method::Qr),
        (random(3_000, 60), Method::Fastest),
        (sparse(3_000, 84), Method::Fastest),
    ] {
        let data = random(3_000, 1);
        let design = StoredDesign::new(&design, &data)?;
        for _ in 0..times {
            black_box(fit(black_box(&design), &Options::default(), method)?);
        }
    }
    Ok(())
}

fn main() -> Outcome {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, name, times] = &arguments[..] else {
        PATHS.iter().for_each(|(name, _)| println!("{name}"));
        return Ok(());
    };
    let (_, path) = PATHS.iter().find(|(known, _)| known == name).ok_or("no such path")?;
    let times: usize = times.parse()?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    pool.install(|| path(times).map_err(|error| error.to_string()))?;
    Ok(())
}
