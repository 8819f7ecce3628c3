//! The report as Markdown.

use std::fmt::Write as _;

use super::GridReport;
use crate::study::machine::Machine;

/// The report as Markdown, tables in the order of the paper's.
pub fn markdown(report: &GridReport) -> String {
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _ = write(report, &mut text);
    text
}

fn write(report: &GridReport, out: &mut String) -> std::fmt::Result {
    let Machine { cpu, threads, gpu, driver, rustc, commit, command, .. } = &report.machine;
    writeln!(out, "# The grid, stage by stage\n")?;
    let (gpu, driver) = (gpu.as_deref().unwrap_or("-"), driver.as_deref().unwrap_or("-"));
    writeln!(out, "{gpu} ({driver}); {cpu}, {threads} threads; rustc {rustc}; commit {commit}")?;
    writeln!(out, "`{command}`")?;
    if report.machine.gpu_is_software || !report.machine.optimised {
        writeln!(out, "\nA software adapter or an unoptimised build: times mean little.")?;
    }
    writeln!(out, "\nPapers' figures: Avril et al. 2012, on an NVIDIA Quadro FX 3600M.")?;

    writeln!(out, "\n## Table 6: update of boxes (α), update of the grid (β), pairs (δ), ms\n")?;
    writeln!(out, "| n | α | β | δ | total | paper α | β | δ | total |")?;
    writeln!(out, "|---|---|---|---|---|---|---|---|---|")?;
    for row in &report.parts {
        let [a, b, d, t] = row.paper_ms.map_or([const { String::new() }; 4], |p| p.map(ms));
        let (alpha, beta) = (ms(row.update_boxes_ms), ms(row.update_grid_ms));
        let (delta, total) = (ms(row.cull_ms), ms(row.total_ms));
        let n = row.n;
        writeln!(out, "| {n} | {alpha} | {beta} | {delta} | {total} | {a} | {b} | {d} | {t} |")?;
    }
    writeln!(
        out,
        "\nα on the CPU, β and δ by the GPU's clock with the transfers, total by the host's."
    )?;

    writeln!(out, "\n## Table 7: without and with the grid, ms a frame\n")?;
    writeln!(out, "| n | without | with | paper without | with |\n|---|---|---|---|---|")?;
    for row in &report.with_and_without {
        let [a, b] = row.paper_ms.map_or([const { String::new() }; 2], |p| p.map(ms));
        let (without, with) = (ms(row.without_ms), ms(row.with_ms));
        writeln!(out, "| {} | {without} | {with} | {a} | {b} |", row.n)?;
    }
    match report.crossing {
        Some(n) => writeln!(out, "\nThe grid is faster from {n} boxes on (paper: beyond 1,000).")?,
        None => writeln!(out, "\nThe grid is not faster at any of these (paper: beyond 1,000).")?,
    }

    writeln!(out, "\n## Figure 5: engines by number of boxes, ms a frame\n")?;
    writeln!(out, "| n | gpu-grid | cpu-grid | cpu-sap | paper |\n|---|---|---|---|---|")?;
    for row in &report.engines {
        let sap = row.cpu_sap_ms.map(ms).unwrap_or_default();
        let paper = row.paper_ms.map(ms).unwrap_or_default();
        let (gpu, cpu) = (ms(row.gpu_grid_ms), ms(row.cpu_grid_ms));
        writeln!(out, "| {} | {gpu} | {cpu} | {sap} | {paper} |", row.n)?;
    }

    writeln!(out, "\n## Figure 6: share of boxes that move\n")?;
    writeln!(out, "| n | moving | ms a frame |\n|---|---|---|")?;
    for row in &report.moving {
        writeln!(out, "| {} | {} % | {} |", row.n, row.moving_percent, ms(row.frame_ms))?;
    }
    writeln!(out, "\nThe paper's time does not depend on it either.")?;

    writeln!(out, "\n## Stages of a uniform scene against their memory traffic, µs\n")?;
    let b = &report.bandwidth;
    writeln!(
        out,
        "Link {:.1} GB/s up, {:.1} down; video memory {:.0} GB/s (copies by the device).\n",
        b.up_gbs, b.down_gbs, b.memory_gbs
    )?;
    writeln!(out, "| n | stage | time | floor | link bytes | memory bytes |")?;
    writeln!(out, "|---|---|---|---|---|---|")?;
    for row in &report.stages {
        let (n, stage, link, memory) = (row.n, &row.stage, row.link_bytes, row.memory_bytes);
        writeln!(
            out,
            "| {n} | {stage} | {:.1} | {:.1} | {link} | {memory} |",
            row.us, row.floor_us
        )?;
    }

    writeln!(out, "\n## Frames under way, uniform scene, frames a second\n")?;
    writeln!(out, "| n | one | two | gain |\n|---|---|---|---|")?;
    for row in &report.under_way {
        let gain = row.two_fps / row.one_fps;
        writeln!(out, "| {} | {:.0} | {:.0} | {gain:.2} |", row.n, row.one_fps, row.two_fps)?;
    }

    writeln!(out, "\n## Scenes: boxes in shared memory → mask in shared memory\n")?;
    writeln!(
        out,
        "| scene | n | pairs | words | compared a box | mask bytes a pair | GPU µs | frame p50 µs | p99 |"
    )?;
    writeln!(out, "|---|---|---|---|---|---|---|---|---|")?;
    for row in &report.scenes {
        let compared = row.compared as f64 / f64::from(row.n.max(1));
        let bytes = row.mask_bytes as f64 / row.pairs.max(1) as f64;
        writeln!(
            out,
            "| {} | {} | {} | {} | {compared:.1} | {bytes:.1} | {:.1} | {:.1} | {:.1} |",
            row.scene, row.n, row.pairs, row.words, row.gpu_us, row.frame_us, row.frame_p99_us
        )?;
    }
    writeln!(out, "\nA list of pairs has 8 bytes a pair.")
}

/// Milliseconds to three digits behind the point.
fn ms(value: f64) -> String {
    format!("{value:.3}")
}
