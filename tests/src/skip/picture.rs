//! The picture: the time of a frame by the share of boxes that move, beside Figure 6 of Avril et al. 2012
//! ("Fast collision culling in large-scale environments using GPU mapping function"), whose time does not
//! depend on it, and beside the best peer. One plot a backend, scene and size, one line a motion.

use std::collections::{BTreeMap, BTreeSet};

use pairmask_lab::study::harness::plot::{Axis, Look, Plot, Series, Unit, standalone};
use pairmask_lab::study::paper_frame_ms;

use super::row::Row;

/// The plots, as an SVG file. `pace` says when frames began.
pub fn picture(rows: &[Row], pace: &str) -> String {
    let panels: BTreeSet<_> = rows.iter().map(panel).collect();
    let plots: Vec<Plot> = panels
        .into_iter()
        .map(|of| {
            let here: Vec<&Row> = rows.iter().filter(|row| panel(row) == of).collect();
            let (backend, scene, n) = of;
            let mut series = own_lines(&here);
            series.extend([paper_line(n, &here), best_peer(&here)]);
            Plot {
                title: format!("{scene}, {} boxes, {backend}", Unit::Count.text(n as f64)),
                x: Axis::new("boxes that move in a frame, %", Unit::Ratio),
                y: Axis::new("edit written to every change visited", Unit::Nanoseconds),
                series,
                level: None,
            }
        })
        .collect();
    let peers: BTreeSet<&str> = rows.iter().map(|row| row.peer).collect();
    let peers: Vec<&str> = peers.into_iter().collect();
    let lines = [
        "Figure 6 of Avril et al. 2012 beside scenes that persist: their frame takes as long whatever moves."
            .to_owned(),
        "Their time is that of table 6, on a Quadro FX 3600M, where they measured that size.".to_owned(),
        format!("Best peer: the fastest of {}, of any motion.", peers.join(", ")),
        format!("Medians. {pace}"),
    ];
    standalone("A frame by the share of boxes that move", &lines, &plots)
}

fn panel(row: &Row) -> (&str, &str, usize) {
    (&row.backend, &row.scene, row.n)
}

fn percent(row: &Row) -> f64 {
    row.moving * 100.0
}

/// A line a motion, in the order of the rows. Rows of several peers share a measurement.
fn own_lines(rows: &[&Row]) -> Vec<Series> {
    let mut lines: Vec<(&str, Vec<(f64, f64)>)> = Vec::new();
    for row in rows {
        let name = row.motion.name();
        let at = lines.iter().position(|line| line.0 == name).unwrap_or_else(|| {
            lines.push((name, Vec::new()));
            lines.len() - 1
        });
        let points = &mut lines[at].1;
        if points.iter().all(|(x, _)| *x != percent(row)) {
            points.push((percent(row), row.total_ns as f64));
        }
    }
    for (_, points) in &mut lines {
        points.sort_by(|a, b| a.0.total_cmp(&b.0));
    }
    let lines = lines.iter().enumerate();
    lines.map(|(colour, (name, points))| Series::line(name, colour, Look::Line, points)).collect()
}

/// The paper's time, over the shares of these rows; without points where it has no such size.
fn paper_line(n: usize, rows: &[&Row]) -> Series {
    let ns = u32::try_from(n).ok().and_then(paper_frame_ms).map(|ms| ms * 1e6);
    let shares = rows.iter().map(|row| percent(row));
    let (least, most) = shares.fold((f64::MAX, 0.0f64), |(a, b), x| (a.min(x), b.max(x)));
    let points = ns.map(|ns| vec![(least, ns), (most, ns)]).unwrap_or_default();
    Series::line("Avril et al. 2012, Figure 6", 0, Look::Others, &points)
}

/// The least time of any peer, by share.
fn best_peer(rows: &[&Row]) -> Series {
    // Keys are bits of floats that are not negative, which sort like the floats.
    let mut best: BTreeMap<u64, u64> = BTreeMap::new();
    for row in rows {
        let here = best.entry(percent(row).to_bits()).or_insert(row.peer_ns);
        *here = row.peer_ns.min(*here);
    }
    let points = best.into_iter().map(|(x, ns)| (f64::from_bits(x), ns as f64));
    Series::line("best peer", 0, Look::Others, &points.collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use pairmask_lab::study::moving::Motion;

    use super::super::row::example;
    use super::*;

    #[test]
    fn a_plot_a_size_has_our_motions_the_paper_and_the_best_peer() {
        let row = |n, moving, motion, peer_ns| Row { n, moving, motion, peer_ns, ..example() };
        let rows = [
            row(10_000, 0.0, Motion::Drift, 400_000),
            row(10_000, 0.01, Motion::Drift, 400_000),
            // The same measurement beside another peer.
            row(10_000, 0.01, Motion::Drift, 120_000),
            row(10_000, 0.01, Motion::Teleport, 500_000),
            row(12_345, 0.01, Motion::Drift, 400_000),
        ];
        let svg = picture(&rows, "At 60 Hz.");
        assert!(svg.contains("pile, 10K boxes, in-process") && svg.contains("pile, 12.3K boxes"));
        for (name, count) in
            [("drift", 2), ("teleport", 1), ("Avril et al. 2012, Figure 6", 2), ("best peer", 2)]
        {
            assert_eq!(svg.matches(&format!("\n{name}\n")).count(), count, "{name}: {svg}");
        }
        let points = |line: &Series| line.points.clone();
        let here: Vec<&Row> = rows[..4].iter().collect();
        let own: Vec<_> = own_lines(&here).iter().map(points).collect();
        let total = example().total_ns as f64;
        assert_eq!(own, [vec![(0.0, total), (1.0, total)], vec![(1.0, total)]], "none twice");
        assert_eq!(points(&paper_line(10_000, &here)), [(0.0, 2.35e6), (1.0, 2.35e6)]);
        assert_eq!(points(&paper_line(12_345, &here)), [], "the paper has no 12,345 boxes");
        assert_eq!(points(&best_peer(&here)), [(0.0, 4e5), (1.0, 1.2e5)]);
        assert!(svg.contains("At 60 Hz."));
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }
}
