//! The scaling plot: ratio to the fastest peer over the number of boxes, one line a scene, one plot a
//! backend and engine.

use std::collections::{BTreeMap, BTreeSet};

use pairmask_lab::study::harness::plot::{Axis, Look, Plot, Series, Unit, standalone};

use super::line::{Comparison, PeerRow};

/// The plots, as an SVG file.
pub fn plot(comparisons: &[Comparison]) -> String {
    let rows: Vec<PeerRow> =
        comparisons.iter().flat_map(Comparison::rows).filter(|row| row.is_best_peer).collect();
    let most_threads = rows.iter().map(|row| row.threads).max().unwrap_or(1);
    let rows: Vec<PeerRow> = rows.into_iter().filter(|row| row.threads == most_threads).collect();
    let panels: BTreeSet<(&str, &str)> = rows.iter().map(panel).collect();
    let plots: Vec<Plot> = panels
        .into_iter()
        .map(|(backend, engine)| {
            let here = rows.iter().filter(|row| panel(row) == (backend, engine));
            let mut scenes: BTreeMap<&str, Vec<(f64, f64)>> = BTreeMap::new();
            for row in here {
                scenes.entry(row.scene.as_str()).or_default().push((row.n as f64, row.ratio));
            }
            let scenes = scenes.into_iter().enumerate().map(|(colour, (scene, mut points))| {
                points.sort_by(|a, b| a.0.total_cmp(&b.0));
                Series::line(scene, colour, Look::Line, &points)
            });
            Plot {
                title: format!("{}, {}, {most_threads} threads", way(backend), chooser(engine)),
                x: Axis::new("boxes in the scene", Unit::Count),
                y: Axis::new("frame time over the fastest peer's", Unit::Ratio),
                series: scenes.collect(),
                level: Some((1.0, "as fast as the fastest peer".to_owned())),
            }
        })
        .collect();
    let peers: BTreeSet<&str> =
        comparisons.iter().flat_map(Comparison::rows).map(|row| row.peer.as_str()).collect();
    let peers: Vec<&str> = peers.into_iter().collect();
    let peers = format!("Time of a frame over that of the fastest of {}.", peers.join(", "));
    let mut lines = broken(&peers);
    lines.extend([
        "Below 1 Pairmask is faster: at 0.25 it takes a quarter of that peer's time.".to_owned(),
        "A frame: all boxes written, pairs found, every pair visited. Medians. One line a scene."
            .to_owned(),
    ]);
    standalone("Pairmask against its fastest peer", &lines, &plots)
}

/// Characters of a line above the plots: more would leave the picture.
const LINE_CHARS: usize = 90;

/// Breaks a text into lines between its words.
fn broken(text: &str) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split(' ') {
        if lines.last().is_some_and(|line| line.len() + 1 + word.len() > LINE_CHARS) {
            lines.push(String::new());
        }
        if let Some(line) = lines.last_mut() {
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(word);
        }
    }
    lines
}

/// How the boxes reached the engine, in words.
fn way(backend: &str) -> String {
    match backend {
        "daemon" => "Through the daemon".to_owned(),
        "in-process" => "In process, without a daemon".to_owned(),
        other => other.to_owned(),
    }
}

/// The engine, in words.
fn chooser(engine: &str) -> String {
    if engine == "auto" { "engine by the plan".to_owned() } else { format!("engine {engine}") }
}

/// Backend, and the engine that was asked for.
fn panel(row: &PeerRow) -> (&'static str, &str) {
    (row.backend, row.engine.split(':').next().unwrap_or_default())
}
