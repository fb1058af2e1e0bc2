//! How close two sets of normal equations must be.

use nvsprior::render::NormalEquations;

/// Largest error of an entry, relative to its bound by Cauchy–Schwarz. On lavapipe the worst is
/// 9e-6, in the reef prior.
const TOLERANCE: f64 = 1e-4;

/// Holds JᵀJ, Jᵀr and Σ r² against the twin's.
pub fn assert_equations(what: &str, got: &NormalEquations, twin: &NormalEquations) {
    assert_eq!(got.residuals, twin.residuals, "{what}");
    let length = |k: usize| twin.jtj[k][k].sqrt();
    let close = |name: String, got: f64, expected: f64, bound: f64| {
        let error = (got - expected).abs() / bound;
        assert!(error <= TOLERANCE, "{what}: {name} = {got}, twin {expected}, off {error:e}");
    };
    for row in 0..6 {
        for column in 0..6 {
            let bound = length(row) * length(column);
            let (got, expected) = (got.jtj[row][column], twin.jtj[row][column]);
            close(format!("JᵀJ[{row}, {column}]"), got, expected, bound);
        }
        let bound = length(row) * twin.square.sqrt();
        close(format!("Jᵀr[{row}]"), got.jtr[row], twin.jtr[row], bound);
    }
    close("Σ r²".into(), got.square, twin.square, twin.square);
}
