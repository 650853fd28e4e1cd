//! NIST's Statistical Reference Datasets for linear regression, <https://www.itl.nist.gov/div898/strd/lls/lls.shtml>.
//!
//! Certified values were computed with 500 digits. How many of their digits double precision can reach is set by the
//! condition of the scaled columns: Longley 4·10⁴, Wampler 2·10³ (relative to a residual that is 0, like the signal's and
//! 10⁴ times it), Filip 5·10⁹. Bounds: digits lost to n·κ·ε, or n·κ²·ε of the residual's size where that is larger.

use geoerr_core::least_squares::{Matrix, Method, Options, Solution, StoredDesign, fit};

use super::common::solved;

const LONGLEY: [[f64; 7]; 16] = [
    [60323., 83.0, 234289., 2356., 1590., 107608., 1947.],
    [61122., 88.5, 259426., 2325., 1456., 108632., 1948.],
    [60171., 88.2, 258054., 3682., 1616., 109773., 1949.],
    [61187., 89.5, 284599., 3351., 1650., 110929., 1950.],
    [63221., 96.2, 328975., 2099., 3099., 112075., 1951.],
    [63639., 98.1, 346999., 1932., 3594., 113270., 1952.],
    [64989., 99.0, 365385., 1870., 3547., 115094., 1953.],
    [63761., 100.0, 363112., 3578., 3350., 116219., 1954.],
    [66019., 101.2, 397469., 2904., 3048., 117388., 1955.],
    [67857., 104.6, 419180., 2822., 2857., 118734., 1956.],
    [68169., 108.4, 442769., 2936., 2798., 120445., 1957.],
    [66513., 110.8, 444546., 4681., 2637., 121950., 1958.],
    [68655., 112.6, 482704., 3813., 2552., 123366., 1959.],
    [69564., 114.2, 502601., 3931., 2514., 125368., 1960.],
    [69331., 115.7, 518173., 4806., 2572., 127852., 1961.],
    [70551., 116.9, 554894., 4007., 2827., 130081., 1962.],
];

const LONGLEY_CERTIFIED: [[f64; 2]; 7] = [
    [-3482258.63459582, 890420.383607373],
    [15.0618722713733, 84.9149257747669],
    [-0.358191792925910E-01, 0.334910077722432E-01],
    [-2.02022980381683, 0.488399681651699],
    [-1.03322686717359, 0.214274163161675],
    [-0.511041056535807E-01, 0.226073200069370],
    [1829.15146461355, 455.478499142212],
];

const FILIP: [[f64; 2]; 82] = [
    [0.8116, -6.860120914],
    [0.9072, -4.324130045],
    [0.9052, -4.358625055],
    [0.9039, -4.358426747],
    [0.8053, -6.955852379],
    [0.8377, -6.661145254],
    [0.8667, -6.355462942],
    [0.8809, -6.118102026],
    [0.7975, -7.115148017],
    [0.8162, -6.815308569],
    [0.8515, -6.519993057],
    [0.8766, -6.204119983],
    [0.8885, -5.853871964],
    [0.8859, -6.109523091],
    [0.8959, -5.79832982],
    [0.8913, -5.482672118],
    [0.8959, -5.171791386],
    [0.8971, -4.851705903],
    [0.9021, -4.517126416],
    [0.909, -4.143573228],
    [0.9139, -3.709075441],
    [0.9199, -3.499489089],
    [0.8692, -6.300769497],
    [0.8872, -5.953504836],
    [0.89, -5.642065153],
    [0.891, -5.031376979],
    [0.8977, -4.680685696],
    [0.9035, -4.329846955],
    [0.9078, -3.928486195],
    [0.7675, -8.56735134],
    [0.7705, -8.363211311],
    [0.7713, -8.107682739],
    [0.7736, -7.823908741],
    [0.7775, -7.522878745],
    [0.7841, -7.218819279],
    [0.7971, -6.920818754],
    [0.8329, -6.628932138],
    [0.8641, -6.323946875],
    [0.8804, -5.991399828],
    [0.7668, -8.781464495],
    [0.7633, -8.663140179],
    [0.7678, -8.473531488],
    [0.7697, -8.247337057],
    [0.77, -7.971428747],
    [0.7749, -7.676129393],
    [0.7796, -7.352812702],
    [0.7897, -7.072065318],
    [0.8131, -6.774174009],
    [0.8498, -6.478861916],
    [0.8741, -6.159517513],
    [0.8061, -6.835647144],
    [0.846, -6.53165267],
    [0.8751, -6.224098421],
    [0.8856, -5.910094889],
    [0.8919, -5.598599459],
    [0.8934, -5.290645224],
    [0.894, -4.974284616],
    [0.8957, -4.64454848],
    [0.9047, -4.290560426],
    [0.9129, -3.885055584],
    [0.9209, -3.408378962],
    [0.9219, -3.13200249],
    [0.7739, -8.726767166],
    [0.7681, -8.66695597],
    [0.7665, -8.511026475],
    [0.7703, -8.165388579],
    [0.7702, -7.886056648],
    [0.7761, -7.588043762],
    [0.7809, -7.283412422],
    [0.7961, -6.995678626],
    [0.8253, -6.691862621],
    [0.8602, -6.392544977],
    [0.8809, -6.067374056],
    [0.8301, -6.684029655],
    [0.8664, -6.378719832],
    [0.8834, -6.065855188],
    [0.8898, -5.752272167],
    [0.8964, -5.132414673],
    [0.8963, -4.811352704],
    [0.9074, -4.098269308],
    [0.9119, -3.66174277],
    [0.9228, -3.2644011],
];

const FILIP_CERTIFIED: [[f64; 2]; 11] = [
    [-1467.48961422980, 298.084530995537],
    [-2772.17959193342, 559.779865474950],
    [-2316.37108160893, 466.477572127796],
    [-1127.97394098372, 227.204274477751],
    [-354.478233703349, 71.6478660875927],
    [-75.1242017393757, 15.2897178747400],
    [-10.8753180355343, 2.23691159816033],
    [-1.06221498588947, 0.221624321934227],
    [-0.670191154593408E-01, 0.142363763154724E-01],
    [-0.246781078275479E-02, 0.535617408889821E-03],
    [-0.402962525080404E-04, 0.896632837373868E-05],
];

/// What Wampler3 adds to Wampler1; Wampler4 and 5 add 100 and 10,000 times that. Orthogonal to the polynomials.
const WAMPLER_NOISE: [f64; 21] = [
    759., -2048., 2048., -2048., 2523., -2048., 2048., -2048., 1838., -2048., 2048., -2048., 1838., -2048.,
    2048., -2048., 2523., -2048., 2048., -2048., 759.,
];

/// Standard deviations certified for Wampler3.
const WAMPLER_DEVIATIONS: [f64; 6] = [
    2152.32624678170,
    2363.55173469681,
    779.343524331583,
    101.475507550350,
    5.64566512170752,
    0.112324854679312,
];

fn polynomial(x: &[f64], degree: usize) -> Matrix {
    // Products one after another, as the datasets' powers are defined.
    let mut a = Matrix::from_fn(x.len(), degree + 1, |_, _| 1.0);
    for j in 1..=degree {
        for (i, &x) in x.iter().enumerate() {
            a[(i, j)] = a[(i, j - 1)] * x;
        }
    }
    a
}

/// Digits that agree in the worst of the values.
fn digits(found: impl IntoIterator<Item = f64>, certified: impl IntoIterator<Item = f64>) -> f64 {
    let each = found.into_iter().zip(certified);
    each.map(|(found, certified)| -((found - certified) / certified).abs().max(1e-15).log10())
        .fold(15.0, f64::min)
}

fn deviations(solution: &Solution) -> Vec<f64> {
    let sigma = (solution.residual_ss[0] / solution.degrees_of_freedom as f64).sqrt();
    solution.standard_errors().iter().map(|error| sigma * error).collect()
}

#[test]
fn longley() {
    let a = Matrix::from_fn(16, 7, |i, j| if j == 0 { 1.0 } else { LONGLEY[i][j] });
    let b = Matrix::from_fn(16, 1, |i, _| LONGLEY[i][0]);
    let solution = solved(&a, &b);
    assert_eq!((solution.rank.rank, solution.degrees_of_freedom), (7, 9));
    // κ = 4.3e4: n·κ·ε = 7e-11 relative to the largest scaled unknown.
    assert!(digits(solution.x.as_slice().iter().copied(), LONGLEY_CERTIFIED.map(|c| c[0])) > 10.0);
    assert!(digits(deviations(&solution), LONGLEY_CERTIFIED.map(|c| c[1])) > 10.0);
    assert!((solution.residual_ss[0] / 836424.055505915 - 1.0).abs() < 1e-12);
    let automatic = fit(&StoredDesign::new(&a, &b).unwrap(), &Options::default(), Method::Fastest).unwrap();
    assert!(!automatic.is_from_normal_equations);
}

#[test]
fn filip() {
    let x: Vec<f64> = FILIP.iter().map(|row| row[1]).collect();
    let a = polynomial(&x, 10);
    let b = Matrix::from_fn(82, 1, |i, _| FILIP[i][0]);
    let solution = solved(&a, &b);
    assert_eq!((solution.rank.rank, solution.degrees_of_freedom), (11, 71));
    // κ = 5e9: n·κ·ε = 1.2e-5 at worst; the error is a few tenths of κ·ε = 1e-6.
    assert!(digits(solution.x.as_slice().iter().copied(), FILIP_CERTIFIED.map(|c| c[0])) > 6.0);
    assert!(digits(deviations(&solution), FILIP_CERTIFIED.map(|c| c[1])) > 6.0);
    assert!((solution.residual_ss[0].sqrt() / (71.0_f64.sqrt() * 0.334801051324544E-02) - 1.0).abs() < 1e-8);
}

#[test]
fn wampler() {
    let x: Vec<f64> = (0..21).map(f64::from).collect();
    let a = polynomial(&x, 5);
    let clean = |coefficient: fn(i32) -> f64| {
        let value = |i: usize| (0..6).map(|j| coefficient(j) * (i as f64).powi(j)).sum::<f64>();
        Matrix::from_fn(21, 1, |i, _| value(i))
    };
    let ones = clean(|_| 1.0);
    let noisy = |size: f64| Matrix::from_fn(21, 1, |i, _| ones[(i, 0)] + size * WAMPLER_NOISE[i]);
    // The data of Wampler2 are decimals with 5 digits, so the sum is rounded to them.
    let tenths = clean(|j| 0.1_f64.powi(j));
    let tenths = Matrix::from_fn(21, 1, |i, _| (tenths[(i, 0)] * 1e5).round() / 1e5);
    let certified_ones = [1.0; 6];
    let certified_tenths: [f64; 6] = std::array::from_fn(|j| 0.1_f64.powi(j as i32));
    for (name, b, certified, noise, least_digits) in [
        ("Wampler1", &ones, certified_ones, 0.0, 8.0),
        ("Wampler2", &tenths, certified_tenths, 0.0, 11.0),
        ("Wampler3", &noisy(1.0), certified_ones, 1.0, 8.0),
        ("Wampler4", &noisy(1e2), certified_ones, 1e2, 7.0),
        ("Wampler5", &noisy(1e4), certified_ones, 1e4, 5.0),
    ] {
        let solution = solved(&a, b);
        assert_eq!(solution.rank.rank, 6);
        let found = digits(solution.x.as_slice().iter().copied(), certified);
        assert!(found > least_digits, "{name}: {found:.1} digits");
        if noise > 0.0 {
            let certified = WAMPLER_DEVIATIONS.map(|deviation| noise * deviation);
            assert!(digits(deviations(&solution), certified) > 10.0, "{name}");
        }
    }
}
