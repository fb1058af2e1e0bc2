//! The built SPIR-V: one module per entry point, as a constant with the entry point's name.

/// A built entry point.
#[derive(Clone, Copy, Debug)]
pub struct Module {
    /// Its name in the module.
    pub entry: &'static str,
    /// The module.
    pub spirv: &'static [u8],
}

/// Makes one constant per entry point: those of each file of the stages.
macro_rules! modules {
    ($($file:ident: $($name:ident)+;)+) => {
        $($(
            #[doc = concat!("Stage `", stringify!($name), "`.")]
            #[allow(non_upper_case_globals)] // Named as the stage is.
            pub const $name: Module = Module {
                entry: concat!(stringify!($file), "::", stringify!($name)),
                spirv: include_bytes!(concat!("../spv/", stringify!($name), ".spv")),
            };
        )+)+

        /// All of them.
        pub const ALL: &[Module] = &[$($($name),+),+];
    };
}

modules! {
    arithmetic: arithmetic;
    bin: bin_count bin_count_lockstep bin_emit bin_emit_lockstep bin_scan bin_scan_lockstep;
    ceilings: ceiling_arithmetic ceiling_copy;
    decode_pose: decode_pose;
    difference: difference;
    pose_jacobian: pose_jacobian;
    project: project project_lockstep;
    pyramid: pyramid;
    quantize_rgb8: quantize_rgb8;
    radix: radix_count radix_count_lockstep radix_scan radix_scan_lockstep radix_scatter radix_scatter_lockstep;
    reduce: reduce;
    solve: solve;
    splat: splat splat_lockstep;
    splat_backward: splat_backward splat_backward_lockstep;
    splat_exact: splat_exact;
    splat_flow: splat_flow splat_flow_lockstep;
    ssim: loss_gradient ssim_back ssim_columns ssim_gradient ssim_rows;
    train_activate: train_activate;
    train_gradient: train_gradient;
    train_slots: train_slots;
    train_step: train_step;
}
