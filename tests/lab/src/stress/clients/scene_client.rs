//! A persistent scene, edited towards the boxes of cases: its answers are taken, dropped or left unread by
//! chance, and what a client knows from them has to be the oracle's pairs, each change reported once.
//!
//! Here are hard boxes, floating-point flags, and edits between the frames of many clients; all verbs, filters, members
//! and ways to name boxes are held to a model by the test `scene_model`.

use std::collections::BTreeSet;

use pairmask::{Aabb, Report, SceneOptions};
use pairmask_core::oracle::{Corners, Pair, truth};
use pairmask_core::scene::{Sets, Step};
use pairmaskd::scene::Random;

use crate::stress::{Case, Finding, compare};

/// Most boxes of most scenes: the oracle compares each box with all others after every edit.
const FEW_BOXES: usize = 250;
/// Most boxes of one scene in [`MANY_ONE_IN`].
const MANY_BOXES: usize = 2_000;
const MANY_ONE_IN: u64 = 8;

#[derive(Clone, Debug, Default)]
pub(super) struct Received {
    pub(super) begun: Vec<[u32; 2]>,
    pub(super) ended: Vec<[u32; 2]>,
    pub(super) pairs: Vec<[u32; 2]>,
    pub(super) is_resync: bool,
}

pub(super) struct SceneClient {
    boxes: Vec<Option<Aabb>>,
    known: BTreeSet<Pair>,
}

impl SceneClient {
    pub(super) fn new(random: &mut Random) -> Self {
        let most = if random.below(MANY_ONE_IN) == 0 { MANY_BOXES } else { FEW_BOXES };
        Self { boxes: vec![None; most], known: BTreeSet::new() }
    }

    pub(super) fn options(&self) -> SceneOptions {
        SceneOptions::default().with_most_boxes(self.boxes.len() as u32)
    }

    /// Draws an edit towards the boxes of a case, which `ask` has answered, if the answer is to be read, and compares
    /// it. Says whether there was one.
    pub(super) fn edit<E>(
        &mut self,
        case: &Case,
        random: &mut Random,
        ask: impl FnOnce(&[Step<'_>], Report, bool) -> Result<Option<Received>, E>,
    ) -> Result<Result<bool, Finding>, E> {
        let (mut removed, mut set, mut boxes) = (Vec::new(), Vec::new(), Vec::new());
        let n = case.boxes.len();
        // All, some or few of the indices take part.
        let one_in = [1, 4, 30, 100][random.below(4) as usize];
        for (index, slot) in self.boxes.iter_mut().enumerate() {
            // Boxes of a larger case before are removed.
            let is_beyond = index >= n;
            if !is_beyond && random.below(one_in) > 0 {
                continue;
            }
            if slot.is_some() && (is_beyond || random.below(8) == 0) {
                removed.push(index as u32);
                *slot = None;
            }
            if !is_beyond && random.below(3) > 0 {
                let is_any = random.below(3) == 0;
                let b = case.boxes[if is_any { random.below(n as u64) as usize } else { index }];
                *slot = Some(b);
                set.push(index as u32);
                boxes.push(b);
            }
        }
        let report = if random.below(6) == 0 { Report::All } else { Report::Changes };
        let is_read = random.below(8) > 2;
        let sets = Sets { indices: (&set).into(), boxes: &boxes };
        let steps = [Step::Remove((&removed).into()), Step::Set(sets)];
        let Some(received) = ask(&steps, report, is_read)? else { return Ok(Ok(false)) };
        Ok(self.check(&received, report).map(|()| true))
    }

    /// Compares pairs (query, index) that queries have found with those of now, each box against each.
    pub(super) fn check_query(
        &self,
        queries: &[Aabb],
        mut found: Vec<[u32; 2]>,
    ) -> Result<(), Finding> {
        let boxes: Vec<_> = self.boxes.iter().map(|b| b.as_ref().map(Corners::of)).collect();
        let mut expected = Vec::new();
        for (query, asked) in (0..).zip(queries) {
            let asked = Corners::of(asked);
            let overlaps = |of: &Option<Corners>| of.as_ref().is_some_and(|of| of.overlap(&asked));
            let indices = (0..).zip(&boxes).filter(|(_, of)| overlaps(of));
            expected.extend(indices.map(|(index, _)| [query, index]));
        }
        found.sort_unstable();
        compare(&found, &expected, &expected)
    }

    /// Compares what a client knows from an answer with the pairs of now.
    fn check(&mut self, received: &Received, report: Report) -> Result<(), Finding> {
        let mut known = match report {
            Report::Changes if !received.is_resync => self.known.clone(),
            _ => BTreeSet::new(),
        };
        for [a, b] in &received.ended {
            if !known.remove(&[*a, *b]) {
                let what = format!("pair ({a}, {b}) ended and was not known");
                return Err(Finding::extra(what, 1, [*a, *b]));
            }
        }
        for [a, b] in received.begun.iter().chain(&received.pairs) {
            if !known.insert([*a, *b]) {
                let what = format!("pair ({a}, {b}) began and was known");
                return Err(Finding::extra(what, 1, [*a, *b]));
            }
        }
        let boxes = self.boxes.iter().map(|b| b.unwrap_or(Aabb::EMPTY));
        let pairs = truth(&boxes.collect::<Vec<_>>()).pairs;
        compare(&known.iter().copied().collect::<Vec<_>>(), &pairs, &pairs)?;
        self.known = known;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_reported_twice_or_never_is_noticed() {
        let mut scene = SceneClient::new(&mut Random::new(1));
        for (slot, x) in scene.boxes.iter_mut().zip([0.0, 0.9, 1.8, 9.0]) {
            *slot = Some(Aabb::from([x, 0.0, 0.0, x + 1.0, 1.0, 1.0]));
        }
        scene.known = BTreeSet::from([[0, 1], [0, 3]]);
        let right = Received { begun: vec![[1, 2]], ended: vec![[0, 3]], ..Received::default() };
        let known = scene.known.clone();
        let mut check = |received: &Received, report| {
            scene.known.clone_from(&known);
            scene.check(received, report)
        };
        assert_eq!(check(&right, Report::Changes), Ok(()));
        let spoils: [fn(&mut Received); 6] = [
            |received| received.begun.clear(),
            |received| received.begun.push([0, 1]),
            |received| received.begun.push([2, 3]),
            |received| received.ended.clear(),
            |received| received.ended.push([2, 3]),
            |received| received.is_resync = true,
        ];
        for (number, spoil) in spoils.into_iter().enumerate() {
            let mut received = right.clone();
            spoil(&mut received);
            assert!(check(&received, Report::Changes).is_err(), "{number}");
        }
        let all = Received { pairs: vec![[0, 1], [1, 2]], is_resync: true, ..Received::default() };
        assert_eq!((check(&all, Report::All), check(&all, Report::Changes)), (Ok(()), Ok(())));
        assert!(check(&Received::default(), Report::All).is_err());
        scene.boxes[0] = None;
        assert!(scene.check(&all, Report::All).is_err());
    }

    #[test]
    fn a_query_that_misses_a_box_or_finds_another_one_is_noticed() {
        let mut scene = SceneClient::new(&mut Random::new(1));
        let at = |x: f32| Aabb::from([x, 0.0, 0.0, x + 1.0, 1.0, 1.0]);
        for (slot, x) in scene.boxes.iter_mut().zip([0.0, 0.5, 9.0]) {
            *slot = Some(at(x));
        }
        let queries = [at(0.0), at(9.5), at(50.0), Aabb::EMPTY];
        let right = vec![[1, 2], [0, 1], [0, 0]];
        assert_eq!(scene.check_query(&queries, right.clone()), Ok(()));
        for wrong in [
            vec![[0, 0], [0, 1]],
            [&right[..], &[[0, 2]]].concat(),
            [&right[..], &[[0, 0]]].concat(),
        ] {
            assert!(scene.check_query(&queries, wrong.clone()).is_err(), "{wrong:?}");
        }
        scene.boxes[2] = None;
        assert!(scene.check_query(&queries, right).is_err());
    }
}
