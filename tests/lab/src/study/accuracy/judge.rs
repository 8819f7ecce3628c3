//! What rows are worth: settings, and the Pareto front.

use serde::Serialize;

use super::rows::AccuracyRow;
use crate::study::harness::plot::{Unit, pareto_front};

/// Rows that answer the same question: of one scene, one size and one distance from the origin, in the order in which
/// they were measured. Rows of f32 boxes do not belong to a setting far from the origin.
pub type Setting<'a> = Vec<&'a AccuracyRow>;

pub fn title(setting: &Setting<'_>) -> String {
    let AccuracyRow { scene, n, offset, .. } = setting[0];
    let far = offset.map_or_else(String::new, |x| format!(", {x:e} from the origin"));
    format!("{scene}, {} boxes{far}", Unit::Count.text(f64::from(*n)))
}

pub fn settings(rows: &[AccuracyRow]) -> Vec<Setting<'_>> {
    let scenes = in_order(rows.iter().map(|row| row.scene.as_str()));
    let place = |row: &AccuracyRow| (scenes.iter().position(|scene| *scene == row.scene), row.n);
    let distance = |row: &AccuracyRow| row.offset.unwrap_or(-1.0);
    let order = |a: &&AccuracyRow, b: &&AccuracyRow| {
        place(a).cmp(&place(b)).then(distance(a).total_cmp(&distance(b)))
    };
    let mut sorted: Vec<&AccuracyRow> = rows.iter().collect();
    sorted.sort_by(order);
    let settings = sorted.chunk_by(|a, b| order(a, b).is_eq());
    settings.map(<[_]>::to_vec).collect()
}

pub fn in_order<T: PartialEq>(values: impl Iterator<Item = T>) -> Vec<T> {
    let mut seen = Vec::new();
    for value in values {
        if !seen.contains(&value) {
            seen.push(value);
        }
    }
    seen
}

pub fn modes(rows: &[AccuracyRow]) -> Vec<String> {
    in_order(rows.iter().map(AccuracyRow::mode_text))
}

const AXES: [&str; 3] = ["p50", "extra_ratio", "bytes_up"];

/// The Pareto front of time, extra pairs and bytes. A mode that is nowhere on it is beaten in every
/// setting that was measured.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Pareto {
    pub axes: Vec<String>,
    pub modes: Vec<ModeVerdict>,
    pub nowhere: Vec<String>,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ModeVerdict {
    pub mode: String,
    pub settings: u64,
    pub disqualified: u64,
    pub on_front: u64,
    pub at: Vec<String>,
}

pub fn costs(row: &AccuracyRow) -> Option<[f64; AXES.len()]> {
    Some([row.p50() as f64, row.error()?, row.bytes_up as f64])
}

impl Pareto {
    pub fn of(rows: &[AccuracyRow]) -> Self {
        let settings = settings(rows);
        let modes: Vec<ModeVerdict> =
            modes(rows).into_iter().map(|mode| verdict(mode, &settings)).collect();
        let nowhere = modes.iter().filter(|v| v.on_front == 0).map(|v| v.mode.clone()).collect();
        Self { axes: AXES.map(str::to_owned).to_vec(), modes, nowhere }
    }
}

fn verdict(mode: String, settings: &[Setting<'_>]) -> ModeVerdict {
    let mut verdict =
        ModeVerdict { mode, settings: 0, disqualified: 0, on_front: 0, at: Vec::new() };
    for setting in settings {
        let is_its = |row: &AccuracyRow| row.mode_text() == verdict.mode;
        if !setting.iter().any(|row| is_its(row)) {
            continue;
        }
        let (runners, costs): (Vec<_>, Vec<_>) =
            setting.iter().filter_map(|row| Some((*row, costs(row)?))).unzip();
        let wins = runners.iter().zip(pareto_front(&costs)).any(|(row, wins)| wins && is_its(row));
        verdict.settings += 1;
        verdict.disqualified += u64::from(!runners.iter().any(|row| is_its(row)));
        verdict.on_front += u64::from(wins);
        verdict.at.extend(wins.then(|| title(setting)));
    }
    verdict
}

#[cfg(test)]
mod tests {
    use super::super::rows::tests::{of_mode, row};
    use super::*;

    #[test]
    fn rows_stand_with_those_of_their_question() {
        let of = |(scene, n, offset): (&str, _, _)| AccuracyRow {
            scene: scene.to_owned(),
            n,
            offset,
            ..row()
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
        let of = |mode: &str, n, p50, extra, bytes_up| AccuracyRow {
            n,
            bytes_up,
            ..of_mode(mode, p50, extra, 0)
        };
        let rows = [
            of("exact", 10, 100, 0, 24),
            of("q16", 10, 120, 3, 12),
            of("q8", 10, 130, 9, 12),
            AccuracyRow { n: 10, bytes_up: 12, ..of_mode("f16", 1, 0, 1) },
            AccuracyRow { offset: Some(1e9), ..of("f64", 10, 900, 9, 24) },
            of("exact", 20, 100, 0, 24),
            of("q16", 20, 90, 0, 12),
        ];
        let pareto = Pareto::of(&rows);
        let verdict = |v: &ModeVerdict| (v.mode.clone(), v.settings, v.disqualified, v.on_front);
        let expected = [
            ("exact", 2, 0, 1),
            ("q16", 2, 0, 2),
            ("q8", 1, 0, 0),
            ("f16", 1, 1, 0),
            ("f64=1e9", 1, 0, 1),
        ];
        let expected = expected.map(|(mode, a, b, c)| (mode.to_owned(), a, b, c));
        assert_eq!(pareto.modes.iter().map(verdict).collect::<Vec<_>>(), expected);
        assert_eq!(pareto.modes[0].at, ["uniform, 10 boxes"]);
        assert_eq!(
            (pareto.nowhere, Pareto::of(&[]).nowhere.len()),
            (["q8", "f16"].map(str::to_owned).to_vec(), 0)
        );
    }
}
