//! The choice of a mode: the use of each, beside its cost and gain in these rows.

use maud::{Markup, html};
use pairmaskd::plot::Unit;

use crate::study::accuracy::pareto::modes;
use crate::study::accuracy::rows::AccuracyRow;
use crate::study::accuracy::setting::settings;

/// A mode against exact frames of the same scene, size and engine.
#[derive(Clone, Debug, PartialEq)]
struct Choice {
    /// As the command line has it.
    mode: String,
    /// Its name without numbers.
    kind: String,
    /// Median frame over that of `exact`, least and most; `None` without such a frame.
    time: Option<[f64; 2]>,
    /// Settings in which it is faster than `exact` with some engine, of those where both were measured.
    faster: [usize; 2],
    /// Most extra pairs for each true one; `None` where no frame was checked, or a pair was missed.
    extra: Option<f64>,
    /// Pairs missed, of boxes.
    missed: u64,
    /// Bytes of a box on its way to the engine.
    box_bytes: Option<u64>,
}

/// The case in which a mode is the one to choose.
fn when(kind: &str) -> &'static str {
    match kind {
        "exact" => "in doubt. No pair is extra, and nothing else is to be known about the scene.",
        "q16" => {
            "boxes cross a slow link to a GPU and the scene's bounds are known: half the bytes, hardly an extra pair."
        }
        "q8" => {
            "a coarse first filter is enough, and pairs are tested again: a quarter of the bytes, many extra pairs."
        }
        "f16" => "as q16 where no bounds are known; finest near the origin.",
        "margin" => {
            "boxes move little from frame to frame: most frames are answered by the mask of an earlier one."
        }
        "f64" => {
            "the world is wider than f32 can tell apart: coordinates in f64, far from the origin."
        }
        "plain-f32" => "never. It shows what rounding a wide world to f32 does.",
        "spheres" => "objects are round, or tested as spheres anyway.",
        _ => "",
    }
}

/// Every mode of the rows, in the order in which they were measured.
fn choices(rows: &[AccuracyRow]) -> Vec<Choice> {
    let settings = settings(rows);
    let of_mode = |mode: &String| {
        let its: Vec<&AccuracyRow> = rows.iter().filter(|row| row.mode_text() == *mode).collect();
        let (mut ratios, mut faster) = (Vec::new(), [0, 0]);
        for setting in &settings {
            let here = setting.rows.iter().filter(|row| row.mode_text() == *mode);
            let here: Vec<f64> = here.filter_map(|row| against_exact(row, rows)).collect();
            faster[0] += usize::from(here.iter().any(|ratio| *ratio < 1.0));
            faster[1] += usize::from(!here.is_empty());
            ratios.extend(here);
        }
        let missed = |row: &&AccuracyRow| row.missed + row.against_boxes.map_or(0, |b| b.missed);
        let errors: Vec<f64> = its.iter().filter_map(|row| row.error()).collect();
        let largest = its.iter().max_by_key(|row| row.n);
        Choice {
            mode: mode.clone(),
            kind: its.first().map_or_else(String::new, |row| row.mode.clone()),
            time: ratios
                .iter()
                .copied()
                .min_by(f64::total_cmp)
                .zip(ratios.iter().copied().max_by(f64::total_cmp))
                .map(|(least, most)| [least, most]),
            faster,
            extra: errors.into_iter().max_by(f64::total_cmp),
            missed: its.iter().map(missed).sum(),
            box_bytes: largest.and_then(|row| row.bytes_up.checked_div(u64::from(row.n))),
        }
    };
    modes(rows).iter().map(of_mode).collect()
}

/// Median frame of a row over that of the exact row of its scene, size and engine.
fn against_exact(row: &AccuracyRow, rows: &[AccuracyRow]) -> Option<f64> {
    let exact = rows.iter().find(|other| {
        other.mode == "exact"
            && (&other.scene, other.n, &other.engine) == (&row.scene, row.n, &row.engine)
    })?;
    let (ours, base) = (row.times.total_ns.p50, exact.times.total_ns.p50);
    (base > 0).then(|| ours as f64 / base as f64)
}

/// The table.
pub(super) fn table(rows: &[AccuracyRow]) -> Markup {
    html! {
        div.scroll { table.choice {
            tr {
                th.name { "choose" } th.name { "when" } th { "frame time, exact = 1" }
                th { "extra pairs, at most" } th { "bytes a box" }
            }
            @for choice in choices(rows) {
                tr {
                    td.name { strong { (breakable(&choice.mode)) } }
                    td.name { (when(&choice.kind)) (here(&choice)) }
                    td { (time(&choice)) }
                    td { (extra(&choice)) }
                    td { (choice.box_bytes.map_or("-".to_owned(), |bytes| bytes.to_string())) }
                }
            }
        } }
    }
}

/// A mode's name, which a narrow screen may break before its number.
fn breakable(mode: &str) -> Markup {
    html! {
        @match mode.split_once('=') {
            Some((name, number)) => { (name) "=" wbr; (number) }
            None => { (mode) }
        }
    }
}

/// The figures of these rows for a choice.
fn here(choice: &Choice) -> Markup {
    let [faster, of] = choice.faster;
    html! {
        @if choice.kind != "exact" && of > 0 {
            " Here it is faster than exact in " (faster) " of " (of)
            @if of == 1 { " scene." } @else { " scenes and sizes." }
        }
    }
}

fn time(choice: &Choice) -> Markup {
    let text = |ratio: f64| Unit::Ratio.text(ratio);
    html! {
        @match choice.time {
            _ if choice.kind == "exact" => { "1" }
            Some([least, most]) if text(least) == text(most) => { (text(least)) }
            Some([least, most]) => { (text(least)) " to " (text(most)) }
            None => { "-" }
        }
    }
}

fn extra(choice: &Choice) -> Markup {
    html! {
        @if choice.missed > 0 { span.bad { "misses pairs" } }
        @else if let Some(extra) = choice.extra {
            @if extra == 0.0 { "none" } @else { (Unit::Ratio.text(100.0 * extra)) " %" }
        } @else { "not known" }
    }
}

#[cfg(test)]
mod tests {
    use super::super::page::tests::row;
    use super::*;

    #[test]
    fn a_mode_is_held_against_exact_frames_of_its_scene_size_and_engine() {
        let large = |mode: &str, p50| AccuracyRow { n: 5000, ..row(mode, p50, 5, 0) };
        let rows = [
            row("exact", 2000, 0, 0),
            row("q16", 1000, 3, 0),
            large("exact", 1000),
            large("q16", 1500),
            row("q8", 4000, 3, 2),
        ];
        let found = choices(&rows);
        assert_eq!(found.len(), 3);
        assert_eq!((found[1].time, found[1].faster), (Some([0.5, 1.5]), [1, 2]));
        assert_eq!((found[2].missed, found[2].faster), (2, [0, 1]));
        let html = table(&rows).into_string();
        for part in ["misses pairs", "0.5 to 1.5", "faster than exact in 1 of 2", "in doubt"] {
            assert!(html.contains(part), "{part}: {html}");
        }
    }

    #[test]
    fn every_kind_of_mode_has_its_advice() {
        for mode in ["exact", "q16", "q8", "f16", "margin", "f64", "plain-f32", "spheres"] {
            assert!(!when(mode).is_empty(), "{mode}");
        }
    }
}
