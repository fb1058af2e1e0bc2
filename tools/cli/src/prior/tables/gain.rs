//! What a scene's own tables save.

use nvsprior::coder_tables::Tables;
use nvsprior::residual::wavelet::Step;
use nvsprior_train::coder_tables::{Pair, measure};

use nvsprior_inputs::report::row;

/// Steps that are shown, from a fine picture to a coarse one.
const STEPS: [u8; 3] = [24, 32, 40];

/// Prints the mean bytes of difference pictures with the generic tables and with these, on frames that these have not
/// seen.
pub fn print(held_out: &[Pair], tables: &Tables) {
    let generic = Tables::generic();
    let (mut all_before, mut all_after) = (0.0, 0.0);
    for step in STEPS.map(Step::new) {
        let of = |tables| measure(held_out, tables, step, true);
        let ((before, psnr_before), (after, psnr_after)) = (of(&generic), of(tables));
        let change = 100.0 * (after / before - 1.0);
        row(
            &format!("step {:.0}", step.value()),
            format!(
                "{before:.1} → {after:.1} bytes per frame, {change:+.1} %; {psnr_before:.2} → {psnr_after:.2} dB"
            ),
        );
        (all_before, all_after) = (all_before + before, all_after + after);
    }
    if all_after >= all_before {
        tell!("the tables save nothing on frames that they have not seen; train on more frames");
    }
}
