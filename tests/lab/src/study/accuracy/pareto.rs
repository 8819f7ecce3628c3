//! The Pareto front of time, extra pairs and bytes. A mode that is nowhere on it is beaten in every
//! setting that was measured.

use std::fmt;

use pairmaskd::plot::pareto_front;
use serde::{Deserialize, Serialize};

use super::rows::AccuracyRow;
use super::setting::{Setting, settings};

/// The axes of the front: smaller is better.
const AXES: [&str; 3] = ["p50", "extra_ratio", "bytes_up"];

/// The verdicts on the modes of a report.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Pareto {
    /// The axes: median of a whole frame, extra pairs a true pair, bytes up.
    pub axes: Vec<String>,
    /// One for every mode.
    pub modes: Vec<ModeVerdict>,
    /// Modes that are nowhere on the front.
    pub nowhere: Vec<String>,
}

/// The results of a mode over all settings.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ModeVerdict {
    /// The mode as the command line has it.
    pub mode: String,
    /// Settings (scene, size, distance from the origin) in which it was measured.
    pub settings: u64,
    /// Settings in which it missed a pair or was not checked, and cannot be on the front.
    pub disqualified: u64,
    /// Settings in which one of its rows is on the front.
    pub on_front: u64,
    /// The names of the settings in `on_front`.
    pub at: Vec<String>,
}

/// Time, extra pairs and bytes up of a row that may be compared.
pub fn costs(row: &AccuracyRow) -> Option<[f64; AXES.len()]> {
    Some([row.times.total_ns.p50 as f64, row.error()?, row.bytes_up as f64])
}

impl Pareto {
    /// Where each mode of the rows is on the front.
    pub fn of(rows: &[AccuracyRow]) -> Self {
        let settings = settings(rows);
        let modes: Vec<ModeVerdict> =
            modes(rows).into_iter().map(|mode| verdict(mode, &settings)).collect();
        let nowhere = modes.iter().filter(|v| v.on_front == 0).map(|v| v.mode.clone()).collect();
        Self { axes: AXES.map(str::to_owned).to_vec(), modes, nowhere }
    }
}

/// Modes in the order in which they were measured.
pub fn modes<'a>(rows: impl IntoIterator<Item = &'a AccuracyRow>) -> Vec<String> {
    let mut modes = Vec::new();
    for mode in rows.into_iter().map(AccuracyRow::mode_text) {
        if !modes.contains(&mode) {
            modes.push(mode);
        }
    }
    modes
}

fn verdict(mode: String, settings: &[Setting<'_>]) -> ModeVerdict {
    let mut verdict =
        ModeVerdict { mode, settings: 0, disqualified: 0, on_front: 0, at: Vec::new() };
    for setting in settings {
        let is_its = |row: &AccuracyRow| row.mode_text() == verdict.mode;
        if !setting.rows.iter().any(|row| is_its(row)) {
            continue;
        }
        let (runners, costs): (Vec<_>, Vec<_>) =
            setting.rows.iter().filter_map(|row| Some((*row, costs(row)?))).unzip();
        let front = pareto_front(&costs);
        let runs = runners.iter().any(|row| is_its(row));
        let wins = runners.iter().zip(front).any(|(row, wins)| wins && is_its(row));
        verdict.settings += 1;
        verdict.disqualified += u64::from(!runs);
        verdict.on_front += u64::from(wins);
        if wins {
            verdict.at.push(setting.title());
        }
    }
    verdict
}

impl fmt::Display for Pareto {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "On the Pareto front of median frame, extra pairs and bytes up:")?;
        for (i, ModeVerdict { mode, settings, on_front, .. }) in self.modes.iter().enumerate() {
            write!(f, "{} {mode} {on_front}/{settings}", if i == 0 { "" } else { "," })?;
        }
        let nowhere =
            if self.nowhere.is_empty() { "none".to_owned() } else { self.nowhere.join(", ") };
        write!(f, "\nNowhere on it: {nowhere}")
    }
}

#[cfg(test)]
mod tests {
    use super::super::rows::tests::row;
    use super::super::rows::{Percentiles, StageTimes};
    use super::*;

    fn of(mode: &str, n: u32, p50: u64, extra: u64, bytes_up: u64) -> AccuracyRow {
        let total_ns = Percentiles { p50, p99: p50 };
        AccuracyRow {
            n,
            mode: mode.to_owned(),
            margin: None,
            times: StageTimes { total_ns, ..StageTimes::default() },
            bytes_up,
            extra,
            extra_ratio: Some(extra as f64 / 1000.0),
            ..row()
        }
    }

    #[test]
    fn modes_that_are_nowhere_on_the_front_are_named() {
        let missing = AccuracyRow { missed: 1, ..of("f16", 10, 1, 0, 12) };
        let far = AccuracyRow { offset: Some(1e9), ..of("f64", 10, 900, 9, 24) };
        let rows = [
            of("exact", 10, 100, 0, 24),
            of("q16", 10, 120, 3, 12),
            of("q8", 10, 130, 9, 12),
            missing,
            far,
            of("exact", 20, 100, 0, 24),
            of("q16", 20, 90, 0, 12),
        ];
        let pareto = Pareto::of(&rows);
        let verdicts: Vec<_> = pareto
            .modes
            .iter()
            .map(|v| (v.mode.as_str(), v.settings, v.disqualified, v.on_front))
            .collect();
        assert_eq!(
            verdicts,
            [
                ("exact", 2, 0, 1),
                ("q16", 2, 0, 2),
                ("q8", 1, 0, 0),
                ("f16", 1, 1, 0),
                ("f64=1e9", 1, 0, 1),
            ],
        );
        assert_eq!(pareto.nowhere, ["q8", "f16"]);
        assert_eq!(pareto.modes[0].at, ["uniform, 10 boxes"]);
        let text = pareto.to_string();
        assert!(text.contains("exact 1/2, q16 2/2") && text.contains("Nowhere on it: q8, f16"));
    }

    #[test]
    fn no_rows_make_no_sentence() {
        let pareto = Pareto::of(&[]);
        assert!(pareto.modes.is_empty() && pareto.to_string().ends_with("none"));
    }
}
