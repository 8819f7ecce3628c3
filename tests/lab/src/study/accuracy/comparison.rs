//! `--compare OLD.json`: rows that have become slower or less exact.

use super::rows::{AccuracyReport, AccuracyRow};

/// A row counts as slower from this ratio of medians on: less is noise on most machines.
const SLOWER: f64 = 1.15;

/// A row that has become worse than it was.
#[derive(Clone, Debug, PartialEq)]
pub struct Regression {
    /// The row.
    pub name: String,
    /// How it has become worse.
    pub what: Worse,
}

/// How a row has become worse.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Worse {
    /// Medians of a whole frame, ns.
    Slower {
        /// In the old report.
        old: u64,
        /// In the new report.
        new: u64,
    },
    /// Missed pairs.
    Missed {
        /// In the old report.
        old: u64,
        /// In the new report.
        new: u64,
    },
    /// Extra pairs for each exact one; infinite where there is no exact one.
    Extra {
        /// In the old report.
        old: f64,
        /// In the new report.
        new: f64,
    },
}

impl std::fmt::Display for Regression {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ms = |ns: u64| ns as f64 / 1e6;
        write!(f, "{}: ", self.name)?;
        match self.what {
            Worse::Slower { old, new } => {
                write!(f, "p50 {:.3} ms, was {:.3} ms", ms(new), ms(old))
            }
            Worse::Missed { old, new } => write!(f, "{new} missed pairs, were {old}"),
            Worse::Extra { old, new } => {
                write!(f, "{:.3} % extra pairs, were {:.3} %", 100.0 * new, 100.0 * old)
            }
        }
    }
}

/// The rows of both reports that are worse in `new` than in `old`.
pub fn regressions(new: &AccuracyReport, old: &AccuracyReport) -> Vec<Regression> {
    let mut found = Vec::new();
    for (new, old) in pairs_of_rows(new, old) {
        let mut worse = |what| found.push(Regression { name: new.name(), what });
        if new.missed > old.missed {
            worse(Worse::Missed { old: old.missed, new: new.missed });
        }
        let ratio = |row: &AccuracyRow| row.extra_ratio.unwrap_or(f64::INFINITY);
        if ratio(new) > ratio(old) {
            worse(Worse::Extra { old: ratio(old), new: ratio(new) });
        }
        let (then, now) = (old.times.total_ns.p50, new.times.total_ns.p50);
        if now as f64 > SLOWER * then as f64 {
            worse(Worse::Slower { old: then, new: now });
        }
    }
    found
}

/// How many rows both reports have.
pub fn common_rows(new: &AccuracyReport, old: &AccuracyReport) -> usize {
    pairs_of_rows(new, old).count()
}

fn pairs_of_rows<'a>(
    new: &'a AccuracyReport,
    old: &'a AccuracyReport,
) -> impl Iterator<Item = (&'a AccuracyRow, &'a AccuracyRow)> {
    let old_of = |row: &AccuracyRow| old.rows.iter().find(|old| old.key() == row.key());
    new.rows.iter().filter_map(move |row| Some((row, old_of(row)?)))
}

#[cfg(test)]
mod tests {
    use super::super::rows::tests::{report, row};
    use super::*;

    #[test]
    fn only_what_is_worse_is_said() {
        let old = report(vec![row()]);
        let changed = |change: fn(&mut AccuracyRow)| {
            let mut new = row();
            change(&mut new);
            let new = report(vec![new]);
            regressions(&new, &old).iter().map(ToString::to_string).collect::<Vec<_>>()
        };
        assert_eq!(changed(|_| ()), [""; 0]);
        assert_eq!(changed(|r| r.times.total_ns.p50 /= 2), [""; 0]);
        assert_eq!(changed(|r| r.times.total_ns.p50 *= 2).len(), 1);
        assert!(changed(|r| r.missed = 3)[0].contains("3 missed pairs, were 0"));
        assert!(changed(|r| r.extra_ratio = Some(0.5))[0].contains("50.000 % extra"));
        assert_eq!(changed(|r| (r.n, r.missed) = (7, 3)), [""; 0], "another row");
        assert_eq!(common_rows(&old, &old), 1);
        assert_eq!(common_rows(&old, &report(vec![])), 0);
    }
}
