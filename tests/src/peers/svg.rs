//! The scaling plot: ratio to the best peer over the number of boxes, one line a scene, one plot a
//! backend and engine.

use std::collections::{BTreeMap, BTreeSet};

use pairmaskd::study::plot::{Line, Lines, Plot, Unit, standalone};

use super::line::{Comparison, Row};

/// The plots, as an SVG file.
pub fn plot(comparisons: &[Comparison]) -> String {
    let rows: Vec<Row> =
        comparisons.iter().flat_map(Comparison::rows).filter(|row| row.is_best_peer).collect();
    let most_threads = rows.iter().map(|row| row.threads).max().unwrap_or(1);
    let rows: Vec<Row> = rows.into_iter().filter(|row| row.threads == most_threads).collect();
    let panels: BTreeSet<(&str, &str)> = rows.iter().map(panel).collect();
    let plots: Vec<Plot> = panels
        .into_iter()
        .map(|(backend, engine)| {
            let here = rows.iter().filter(|row| panel(row) == (backend, engine));
            let mut scenes: BTreeMap<&str, Vec<(f64, f64)>> = BTreeMap::new();
            for row in here {
                scenes.entry(row.scene.as_str()).or_default().push((row.n as f64, row.ratio));
            }
            let scenes = scenes.into_iter().map(|(scene, mut points)| {
                points.sort_by(|a, b| a.0.total_cmp(&b.0));
                Line { name: scene.to_owned(), points }
            });
            Lines {
                title: format!("{backend}, {engine}, {most_threads} threads"),
                x_label: "boxes".to_owned(),
                y_label: "time / the best peer's".to_owned(),
                x_unit: Unit::Count,
                y_unit: Unit::Ratio,
                lines: scenes.collect(),
            }
            .draw()
        })
        .collect();
    standalone(&plots)
}

/// Backend, and the engine that was asked for.
fn panel(row: &Row) -> (&'static str, &str) {
    (row.backend, row.engine.split(':').next().unwrap_or_default())
}
