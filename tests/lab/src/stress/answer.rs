//! How a case is asked, what is answered, and the one comparison of an answer with the truth.
//!
//! An answer may have more pairs than the truth where the form's contract allows that (a mode that rounds
//! boxes outward), never fewer: [`compare`] takes the pairs that must be in it and those that may be.

use std::fmt;

use pairmask_core::engine::Census;
use pairmask_core::oracle::Pair;
use pairmaskd::explain::{SentBoxes, explain};
use pairmaskd::shown::Shown;
use serde::{Deserialize, Serialize};

use super::case::Case;
use super::modes::{self, Sending, Usage};

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Form {
    /// Boxes in f32, in one frame.
    Boxes,
    Spheres,
    Mode(Usage),
    /// Edits of a persistent scene, towards the boxes: by the clients of a daemon.
    Scene,
}

impl Form {
    pub const fn mode(self) -> &'static str {
        match self {
            Self::Mode(usage) => usage.mode(),
            _ => "exact",
        }
    }
}

impl fmt::Display for Form {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Boxes => f.write_str("boxes"),
            Self::Spheres => f.write_str("spheres"),
            Self::Mode(usage) => usage.fmt(f),
            Self::Scene => f.write_str("scenes"),
        }
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answer {
    pub pairs: Vec<Pair>,
    pub count: u64,
    pub census: Census,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Reply {
    Pairs(Answer),
    /// An answer that was compared where it was given, and is right.
    Right,
    /// None: the engine left a scene with too many boxes in one place to another engine
    /// ([`CullError::TooCrowded`](pairmask_core::engine::CullError)), which is allowed.
    Declined,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finding {
    pub what: String,
    pub missed: u64,
    pub extra: u64,
    /// The first wrong one.
    pub pair: Option<Pair>,
}

impl Finding {
    pub fn other(what: &impl ToString) -> Self {
        Self { what: what.to_string(), missed: 0, extra: 0, pair: None }
    }

    pub(super) const fn extra(what: String, extra: u64, pair: Pair) -> Self {
        Self { what, missed: 0, extra, pair: Some(pair) }
    }
}

/// Checks a sorted list of pairs: nothing twice, all of `must`, none outside `may`, of which `must` is a part.
pub fn compare(got: &[Pair], must: &[Pair], may: &[Pair]) -> Result<(), Finding> {
    if let Some(two) = got.windows(2).find(|two| two[0] >= two[1]) {
        let what = if two[0] == two[1] {
            format!("pair {:?} is in the answer twice", two[0])
        } else {
            format!("pair {:?} comes after {:?}", two[1], two[0])
        };
        return Err(Finding::extra(what, 1, two[1]));
    }
    let (missed, first_missed) = count(absent(must, got));
    let (extra, first_extra) = count(absent(got, may));
    let (what, first) = match (first_missed, first_extra) {
        (None, None) => return Ok(()),
        (Some(pair), None) => (format!("pair {pair:?} is missing"), pair),
        (Some(pair), Some(extra)) if pair <= extra => (format!("pair {pair:?} is missing"), pair),
        (_, Some(pair)) => (format!("pair {pair:?} does not overlap"), pair),
    };
    Err(Finding { what, missed, extra, pair: Some(first) })
}

/// Those of a list that a sorted one lacks.
pub(crate) fn absent(these: &[Pair], those: &[Pair]) -> impl Iterator<Item = Pair> {
    these.iter().filter(|pair| those.binary_search(pair).is_err()).copied()
}

fn count(mut pairs: impl Iterator<Item = Pair>) -> (u64, Option<Pair>) {
    let first = pairs.next();
    (u64::from(first.is_some()) + pairs.count() as u64, first)
}

impl Case {
    pub fn check(&self, form: Form, answer: &Answer) -> Result<(), Finding> {
        let Answer { pairs, count, census } = answer;
        let (must, may, expected) = self.allowed(form);
        let compared = compare(pairs, must, may).and_then(|()| match form {
            Form::Mode(usage) => modes::check_gaps(self.in_mode(usage), pairs),
            _ => Ok(()),
        });
        compared.map_err(|found| {
            let about = found.pair.and_then(|pair| self.objects(form, pair)).unwrap_or_default();
            Finding { what: format!("{form}: {}{about}", found.what), ..found }
        })?;
        if *count != pairs.len() as u64 {
            let decoded = pairs.len();
            let what = format!("the answer counts {count} pairs, the mask has {decoded}");
            return Err(Finding::other(&what));
        }
        let expected = expected.unwrap_or(*census);
        if expected != *census {
            return Err(Finding::other(&format!("census {census:?}, expected {expected:?}")));
        }
        Ok(())
    }

    /// The pairs that must be in an answer, those that may be, and the census; the oracle counts none of spheres.
    pub(super) fn allowed(&self, form: Form) -> (&[Pair], &[Pair], Option<Census>) {
        match form {
            Form::Mode(usage) => {
                let allowed = &self.in_mode(usage).allowed;
                (&allowed.must.pairs, &allowed.may, Some(allowed.must.census))
            }
            Form::Spheres => (&self.spheres().pairs, &self.spheres().pairs, None),
            _ => (&self.truth.pairs, &self.truth.pairs, Some(self.truth.census)),
        }
    }

    fn objects(&self, form: Form, [a, b]: Pair) -> Option<String> {
        let (a, b) = (a as usize, b as usize);
        match form {
            Form::Spheres => {
                let all = &self.spheres().spheres;
                Some(format!(": {:?} and {:?}", all.get(a)?, all.get(b)?))
            }
            Form::Mode(usage) => {
                let Sending::World { boxes, origin } = &self.in_mode(usage).sending else {
                    return None;
                };
                Some(format!(": {:?} and {:?} around {origin:?}", boxes.get(a)?, boxes.get(b)?))
            }
            _ => None,
        }
    }

    /// Why a pair must be in the answer or not. None about spheres and scenes, whose boxes were moved.
    pub(super) fn explain(&self, form: Form, [i, j]: Pair) -> Option<Shown> {
        match form {
            Form::Boxes => explain(&self.boxes, &SentBoxes::exact(&self.boxes), i, j).ok(),
            Form::Mode(usage) => self.in_mode(usage).explain(i, j),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_between_must_and_may_are_right() {
        let (must, may) = ([[0, 1], [2, 3]], [[0, 1], [0, 2], [2, 3]]);
        assert_eq!(compare(&must, &must, &may), Ok(()));
        assert_eq!(compare(&may, &must, &may), Ok(()));
        for (got, missed, extra, first, word) in [
            (&may[..2], 1, 0, [2, 3], "missing"),
            (&[[0, 1], [0, 3], [2, 3]], 0, 1, [0, 3], "overlap"),
            (&[[0, 3]], 2, 1, [0, 1], "missing"),
            (&[[0, 1], [0, 1], [2, 3]], 0, 1, [0, 1], "twice"),
            (&[[2, 3], [0, 1]], 0, 1, [0, 1], "after"),
        ] {
            let found = compare(got, &must, &may).expect_err(word);
            assert_eq!((found.missed, found.extra, found.pair), (missed, extra, Some(first)));
            assert!(found.what.contains(word), "{}", found.what);
        }
    }

    #[test]
    fn every_fault_of_an_answer_is_noticed_in_every_form() {
        let forms = || [Form::Boxes, Form::Spheres].into_iter().chain(Usage::ALL.map(Form::Mode));
        let has_pairs = |case: &Case| forms().all(|form| case.allowed(form).0.len() > 5);
        let case = (1..1_000).map(Case::new).find(has_pairs).expect("a case with pairs");
        for form in forms() {
            let (must, _, census) = case.allowed(form);
            let of = |pairs: Vec<Pair>| Answer {
                count: pairs.len() as u64,
                pairs,
                census: census.unwrap_or_default(),
            };
            let (right, no_object) = (of(must.to_vec()), [u32::MAX - 1, u32::MAX]);
            let mut census = right.census;
            census.empty += 1;
            assert_eq!(case.check(form, &right), Ok(()), "{form}");
            for (wrong, missed, extra) in [
                (of(must[1..].to_vec()), 1, 0),
                (of([&must[..1], must].concat()), 0, 1),
                (of([must, &[no_object]].concat()), 0, 1),
                (Answer { count: right.count + 1, ..right.clone() }, 0, 0),
                (Answer { census, ..right.clone() }, 0, 0),
            ] {
                match case.check(form, &wrong) {
                    Err(found) => assert_eq!((found.missed, found.extra), (missed, extra)),
                    Ok(()) => assert!(form == Form::Spheres && wrong.census == census, "{form}"),
                }
            }
        }
    }
}
