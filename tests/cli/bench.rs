//! `nvsprior bench`.

use crate::dive::{Dive, INPUT, name};

#[test]
fn bench_writes_table_report_and_plot() {
    let dive = Dive::new();
    let offset = "--start-offset 0.03,0,0,0.5,0,0";
    let run = dive.run(&format!("bench {INPUT} --limit 2 {offset} --out out")).ends_with(0);
    let csv = String::from_utf8(dive.bytes("out/bench.csv")).unwrap();
    assert!(csv.starts_with("optimizer,file,evaluation,level,psnr,milliseconds\n"), "{csv}");
    let svg = String::from_utf8(dive.bytes("out/bench.svg")).unwrap();
    assert!(svg.trim_end().ends_with("</svg>"), "{svg}");
    let report = dive.json("out/bench.json");
    for (index, optimizer) in ["gauss-newton", "bfgs"].into_iter().enumerate() {
        for t in 0..2 {
            assert!(csv.contains(&format!("\n{optimizer},{},0,", name(t))), "{csv}");
            assert!(!report["optimizers"][index]["frames"][t].is_null(), "{report}");
        }
        assert_eq!(report["optimizers"][index]["optimizer"], optimizer);
        assert!(svg.contains(optimizer) && run.stdout.contains(optimizer));
    }
    let stages = report["stage_milliseconds"]["picture"].as_object().unwrap();
    assert!(stages["splat"].as_f64().unwrap() > 0.0, "{stages:?}");
}
