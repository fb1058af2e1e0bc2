// The entry points by the file of the stages that has them. `make shaders` writes this.
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
