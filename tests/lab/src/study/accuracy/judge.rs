//! What rows are worth: settings, and the Pareto front.

use serde_json::Value;

use crate::study::harness::plot::{Unit, pareto_front};
use crate::study::harness::table::{Fields, row};

/// Rows that answer the same question: of one scene, one size and one distance from the origin, in the order in which
/// they were measured. Rows of f32 boxes do not belong to a setting far from the origin.
pub type Setting<'a> = Vec<&'a Fields>;

pub fn title(setting: &Setting<'_>) -> String {
    let row = setting[0];
    let far =
        row["offset"].as_f64().map_or_else(String::new, |x| format!(", {x:e} from the origin"));
    let n = Unit::Count.text(row["n"].as_f64().unwrap_or(0.0));
    format!("{}, {n} boxes{far}", text(row, "scene"))
}

pub fn text<'a>(row: &'a Fields, name: &str) -> &'a str {
    row[name].as_str().unwrap_or_default()
}

/// The median of whole frames, ns.
pub fn p50(row: &Fields) -> f64 {
    row["times"]["total_ns"]["p50"].as_f64().unwrap_or(0.0)
}

pub fn settings(rows: &[Fields]) -> Vec<Setting<'_>> {
    let scenes = in_order(rows, "scene");
    let place = |row: &Fields| {
        let scene = scenes.iter().position(|scene| *scene == text(row, "scene"));
        (scene, row["n"].as_u64())
    };
    let distance = |row: &Fields| row["offset"].as_f64().unwrap_or(-1.0);
    let order = |a: &&Fields, b: &&Fields| {
        place(a).cmp(&place(b)).then(distance(a).total_cmp(&distance(b)))
    };
    let mut sorted: Vec<&Fields> = rows.iter().collect();
    sorted.sort_by(order);
    let settings = sorted.chunk_by(|a, b| order(a, b).is_eq());
    settings.map(<[_]>::to_vec).collect()
}

/// The different texts of a field, in the order of the rows.
pub fn in_order<'a>(rows: &'a [Fields], name: &str) -> Vec<&'a str> {
    let mut seen = Vec::new();
    for row in rows {
        if !seen.contains(&text(row, name)) {
            seen.push(text(row, name));
        }
    }
    seen
}

const AXES: [&str; 3] = ["p50", "extra_ratio", "bytes_up"];

fn costs(row: &Fields) -> Option<[f64; AXES.len()]> {
    Some([p50(row), row["error_percent"].as_f64()?, row["bytes_up"].as_f64()?])
}

/// The Pareto front of time, extra pairs and bytes: its axes, a row for each mode, and the modes that are nowhere on
/// it, which are beaten in every setting that was measured.
pub fn pareto(rows: &[Fields]) -> (Vec<Fields>, Fields) {
    let settings = settings(rows);
    let modes: Vec<Fields> =
        in_order(rows, "precision").into_iter().map(|mode| verdict(mode, &settings)).collect();
    let nowhere = modes.iter().filter(|mode| mode["on_front"] == 0);
    let nowhere: Vec<Value> = nowhere.map(|mode| mode["mode"].clone()).collect();
    let pareto = row!(axes: AXES, modes, nowhere);
    (modes, pareto)
}

fn verdict(mode: &str, all: &[Setting<'_>]) -> Fields {
    let is_its = |row: &Fields| text(row, "precision") == mode;
    let (mut settings, mut disqualified, mut at) = (0, 0, Vec::new());
    for setting in all.iter().filter(|setting| setting.iter().any(|row| is_its(row))) {
        let (runners, costs): (Vec<_>, Vec<_>) =
            setting.iter().filter_map(|row| Some((*row, costs(row)?))).unzip();
        let wins = runners.iter().zip(pareto_front(&costs)).any(|(row, wins)| wins && is_its(row));
        settings += 1;
        disqualified += u64::from(!runners.iter().any(|row| is_its(row)));
        at.extend(wins.then(|| title(setting)));
    }
    row!(mode, settings, disqualified, on_front: at.len(), at)
}

#[cfg(test)]
mod tests {
    use super::super::report::tests::row;
    use super::*;

    #[test]
    fn rows_stand_with_those_of_their_question() {
        let of = |(scene, n, offset): (&str, u32, Option<f64>)| {
            let mut row = row("exact", 1, 0, 0);
            row.extend(row!(scene, n, offset));
            row
        };
        let far = ("pile", 1000, Some(1e9));
        let near = ("pile", 1000, None);
        let rows = [("pile", 10_000, None), far, ("cubes", 1000, None), near, near].map(of);
        let settings = settings(&rows);
        let titles: Vec<String> = settings.iter().map(title).collect();
        let far = "pile, 1K boxes, 1e9 from the origin";
        assert_eq!(titles, ["pile, 1K boxes", far, "pile, 10K boxes", "cubes, 1K boxes"]);
        assert_eq!(settings[0].len(), 2);
    }

    #[test]
    fn modes_that_are_nowhere_on_the_front_are_named() {
        let of = |mode: &str, n: u32, p50, extra, missed, bytes_up: u64| {
            let offset = (mode == "f64=1e9").then_some(1e9);
            let mut row = row(mode, p50, extra, missed);
            row.extend(row!(n, offset, bytes_up));
            row
        };
        let rows = [
            of("exact", 10, 100, 0, 0, 24),
            of("q16", 10, 120, 3, 0, 12),
            of("q8", 10, 130, 9, 0, 12),
            of("f16", 10, 1, 0, 1, 12),
            of("f64=1e9", 10, 900, 9, 0, 24),
            of("exact", 20, 100, 0, 0, 24),
            of("q16", 20, 90, 0, 0, 12),
        ];
        let (modes, pareto) = pareto(&rows);
        let verdict = |verdict: &Fields| {
            let counts = ["settings", "disqualified", "on_front"];
            (text(verdict, "mode").to_owned(), counts.map(|name| verdict[name].as_u64()))
        };
        let expected = [
            ("exact", [2, 0, 1]),
            ("q16", [2, 0, 2]),
            ("q8", [1, 0, 0]),
            ("f16", [1, 1, 0]),
            ("f64=1e9", [1, 0, 1]),
        ];
        let expected = expected.map(|(mode, counts)| (mode.to_owned(), counts.map(Some)));
        assert_eq!(modes.iter().map(verdict).collect::<Vec<_>>(), expected);
        assert_eq!(modes[0]["at"], serde_json::json!(["uniform, 10 boxes"]));
        assert_eq!(pareto["nowhere"], serde_json::json!(["q8", "f16"]));
    }
}
