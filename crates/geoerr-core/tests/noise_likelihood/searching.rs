//! The fit: a maximum within bounds, and the same bytes for any number of threads.

use proptest::prelude::*;

use super::scene::{Scene, scenes};

const SHORTEST: f64 = 0.1;

fn bounds(i: usize) -> (f64, f64) {
    match i {
        0 => (f64::NEG_INFINITY, f64::INFINITY),
        1 | 2 => (-16.0, 9.0),
        _ => (SHORTEST.ln(), 2.0_f64.ln()),
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 40, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_neighbour_is_better(scene in scenes(), is_restricted in any::<bool>()) {
        let likelihood = scene.likelihood();
        let found = likelihood.fit(None, SHORTEST, is_restricted).unwrap();
        let (value, _) = likelihood.minus_twice_ln(&found.logs, is_restricted).unwrap();
        prop_assert_eq!(value, found.minus_twice_ln_likelihood);
        for c in 0..3 {
            for i in 0..4 {
                let (low, high) = bounds(i);
                prop_assert!(low <= found.logs[c][i] && found.logs[c][i] <= high);
                for step in [-0.3, 0.3] {
                    let mut moved = found.logs;
                    moved[c][i] = (moved[c][i] + step).clamp(low, high);
                    let (other, _) = likelihood.minus_twice_ln(&moved, is_restricted).unwrap();
                    // Several times what a fit is content with.
                    prop_assert!(other > value - 0.1, "{:?} by {step}: {other} and {value}", (c, i));
                }
            }
        }
    }

    #[test]
    fn a_fit_from_where_one_ended_stays_there(scene in scenes()) {
        let likelihood = scene.likelihood();
        let first = likelihood.fit(None, SHORTEST, true).unwrap();
        let second = likelihood.fit(Some(first.logs), SHORTEST, true).unwrap();
        let gained = first.minus_twice_ln_likelihood - second.minus_twice_ln_likelihood;
        prop_assert!((0.0..0.1).contains(&gained));
    }
}

#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    let scene = Scene::new(7, 3000, &[30, 20, 25], 40);
    let by = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let likelihood = scene.likelihood();
            let fitted = likelihood.fit(None, SHORTEST, true).unwrap();
            let basis = likelihood.whitened_basis(&scene.weights, &scene.basis, &fitted.logs).unwrap();
            (fitted, basis)
        })
    };
    let one = by(1);
    assert!(one.1.is_some());
    assert_eq!(one, by(2));
    assert_eq!(one, by(5));
}
