// The entry points by the file of the stages that has them. `make shaders` writes this.
modules! {
    arithmetic: arithmetic;
    bin: bin_count bin_count_lockstep bin_count_wave16 bin_count_wave32 bin_count_wave64 bin_emit
        bin_emit_lockstep bin_emit_wave16 bin_emit_wave32 bin_emit_wave64 bin_scan bin_scan_lockstep
        bin_scan_wave16 bin_scan_wave32 bin_scan_wave64;
    ceilings: ceiling_arithmetic ceiling_copy;
    filter_layer: filter_layer;
    pose_jacobian: pose_jacobian;
    project: project project_lockstep;
    pyramid: pyramid;
    quantize_rgb8: quantize_rgb8;
    radix: radix_count radix_count_lockstep radix_scatter radix_scatter_lockstep;
    radix_waves: radix_scatter_wave16 radix_scatter_wave32 radix_scatter_wave64;
    reduce: reduce;
    solve: solve;
    splat: splat splat_lockstep splat_wave16 splat_wave32 splat_wave64;
    splat_backward: splat_backward splat_backward_lockstep;
    splat_exact: splat_exact;
    splat_flow: splat_flow splat_flow_lockstep splat_flow_wave16 splat_flow_wave32 splat_flow_wave64;
    ssim: loss_gradient ssim_back ssim_back_lockstep ssim_columns ssim_columns_lockstep
        ssim_gradient ssim_gradient_lockstep ssim_rows ssim_rows_lockstep;
    train_activate: train_activate train_activate_lockstep;
    train_gradient: train_gradient;
    train_slots: train_slots;
    train_step: train_step train_step_lockstep;
}
