//! A scene that persists, edited towards the boxes of cases: its answers are taken, dropped or left unread by
//! chance, and what a client knows from them has to be the oracle's pairs, each change told once.
//!
//! Scenes of cores and of a GPU are asked case by case ([`SceneSubject`]), those of sessions by the clients
//! of a daemon. Why pairs end, filters, members and resyncs are held to a model by
//! the test `scene_model`.

use std::collections::BTreeSet;
use std::sync::Arc;

use pairmask::Aabb;
use pairmask::scene::{Indices, SceneOptions, Want};
use pairmask_core::engine::CullError;
use pairmask_core::oracle::{Pair, truth};
use pairmask_core::scene::{Edit, Scene, SceneError, Sets, Step, Told};
use pairmaskd::execute::gpu::{GpuScene, SceneTools};
use pairmaskd::scene::Random;
use rayon::ThreadPool;

use super::Subject;
use super::answer::{Finding, Form, Reply, compare};
use super::case::Case;

/// Makes the random numbers of edits independent of those of boxes.
const STREAM: u64 = 0x5343_454e_4553;
/// Most boxes of most scenes: the oracle compares each box with all others after every edit.
const FEW_BOXES: usize = 250;
/// Most boxes of one scene in [`MANY_ONE_IN`].
const MANY_BOXES: usize = 2_000;
const MANY_ONE_IN: u64 = 8;
/// Indices beyond the boxes of a case that are in use now and then.
const SPARE: usize = 8;

const WANTS: [Want; 6] =
    [Want::Changes, Want::Changes, Want::Changes, Want::Moved, Want::All, Want::Nothing];

/// What is done about an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fate {
    Taken,
    Dropped,
    Unread,
}

/// What an answer tells of pairs.
#[derive(Clone, Debug, Default)]
pub(super) struct Heard {
    pub(super) begun: Vec<[u32; 2]>,
    pub(super) ended: Vec<[u32; 2]>,
    pub(super) pairs: Vec<[u32; 2]>,
    pub(super) is_resync: bool,
}

/// A box of a scene; none, where it overlaps nothing.
#[derive(Clone, Copy)]
struct Body {
    b: Aabb,
    is_there: bool,
    is_on: bool,
    is_static: bool,
}

const NOBODY: Body = Body { b: Aabb::EMPTY, is_there: false, is_on: true, is_static: false };

pub(super) struct KeptScene {
    bodies: Vec<Body>,
    /// The pairs that the client knows from the answers that it took.
    known: BTreeSet<Pair>,
}

impl KeptScene {
    pub(super) fn new(random: &mut Random) -> Self {
        let most = if random.below(MANY_ONE_IN) == 0 { MANY_BOXES } else { FEW_BOXES };
        Self { bodies: vec![NOBODY; most + SPARE], known: BTreeSet::new() }
    }

    pub(super) fn options(&self) -> SceneOptions {
        SceneOptions::default().with_most_boxes(self.bodies.len() as u32)
    }

    /// Draws an edit towards the boxes of a case, which `ask` has answered, and compares the answer. Says
    /// whether there was one.
    pub(super) fn edit<E>(
        &mut self,
        case: &Case,
        random: &mut Random,
        ask: impl FnOnce(&[Step<'_>], Want, Fate) -> Result<Option<Heard>, E>,
    ) -> Result<Result<bool, Finding>, E> {
        let most = self.bodies.len() - SPARE;
        let edit = self.draw(&case.boxes[..case.boxes.len().min(most)], random);
        let want = WANTS[random.below(WANTS.len() as u64) as usize];
        let fate = match random.below(8) {
            0 => Fate::Unread,
            1..=2 => Fate::Dropped,
            _ => Fate::Taken,
        };
        let words = edit.as_mask();
        let Some(heard) = ask(&edit.as_steps(words.as_deref()), want, fate)? else {
            return Ok(Ok(false));
        };
        Ok(self.check(&heard, want, fate).map(|()| true))
    }

    fn draw(&mut self, boxes: &[Aabb], random: &mut Random) -> ListedEdit {
        let mut edit = ListedEdit::default();
        let n = boxes.len() as u64;
        // All, some or few of the indices take part.
        let one_in = [1, 4, 30, 100][random.below(4) as usize];
        for (index, body) in self.bodies.iter_mut().enumerate() {
            // Boxes of a larger case before are removed.
            let is_beyond = index >= boxes.len() + SPARE;
            if !is_beyond && random.below(one_in) > 0 {
                continue;
            }
            if body.is_there && (is_beyond || random.below(8) == 0) {
                edit.removed.push(index as u32);
                *body = NOBODY;
            }
            if is_beyond {
                continue;
            }
            if n > 0 && random.below(3) > 0 {
                let from = if random.below(3) == 0 { random.below(n) } else { index as u64 % n };
                body.b = boxes[from as usize];
                body.is_there = true;
                edit.set.push(index as u32);
                edit.boxes.push(body.b);
            }
            if body.is_there && random.below(10) == 0 {
                let flag = random.below(4) as usize;
                edit.flags[flag].push(index as u32);
                match flag {
                    0 | 1 => body.is_on = flag == 1,
                    _ => body.is_static = flag == 3,
                }
            }
        }
        edit
    }

    fn pairs(&self) -> Vec<Pair> {
        let on = |body: &Body| if body.is_on { body.b } else { Aabb::EMPTY };
        let mut pairs = truth(&self.bodies.iter().map(on).collect::<Vec<_>>()).pairs;
        let is_static = |index: u32| self.bodies[index as usize].is_static;
        pairs.retain(|(a, b)| !(is_static(*a) && is_static(*b)));
        pairs
    }

    /// Compares what a client knows from an answer with the pairs of now.
    fn check(&mut self, heard: &Heard, want: Want, fate: Fate) -> Result<(), Finding> {
        let mut known = match want {
            Want::Changes if !heard.is_resync => self.known.clone(),
            Want::Changes | Want::All => BTreeSet::new(),
            _ => return Ok(()),
        };
        for [a, b] in &heard.ended {
            if !known.remove(&(*a, *b)) {
                let what = format!("pair ({a}, {b}) ended and was not known");
                return Err(Finding::extra(what, 1, (*a, *b)));
            }
        }
        for [a, b] in heard.begun.iter().chain(&heard.pairs) {
            if !known.insert((*a, *b)) {
                let what = format!("pair ({a}, {b}) began and was known");
                return Err(Finding::extra(what, 1, (*a, *b)));
            }
        }
        let pairs = self.pairs();
        compare(&known.iter().copied().collect::<Vec<_>>(), &pairs, &pairs)?;
        if fate == Fate::Taken {
            self.known = known;
        }
        Ok(())
    }
}

/// An edit by lists of indices, each of which rises.
#[derive(Clone, Debug, Default)]
struct ListedEdit {
    removed: Vec<u32>,
    set: Vec<u32>,
    boxes: Vec<Aabb>,
    /// Disabled, enabled, no longer static, static.
    flags: [Vec<u32>; 4],
}

impl ListedEdit {
    fn as_steps<'a>(&'a self, set: Option<&'a [u32]>) -> [Step<'a>; 6] {
        let listed = Indices::List(&self.set);
        let indices = set.map_or(listed, |words| Indices::Mask { first: 0, words });
        let [off, on, loose, fixed] = &self.flags;
        [
            Step::Remove((&self.removed).into()),
            Step::Set(Sets { indices, boxes: &self.boxes }),
            Step::Switch(off.into(), false),
            Step::Switch(on.into(), true),
            Step::Static(loose.into(), false),
            Step::Static(fixed.into(), true),
        ]
    }

    /// The boxes that are set as bits, where that is the shorter way to name them.
    fn as_mask(&self) -> Option<Vec<u32>> {
        let mut words = vec![0u32; *self.set.last()? as usize / 32 + 1];
        for index in &self.set {
            words[*index as usize / 32] |= 1 << (index % 32);
        }
        (words.len() < self.set.len()).then_some(words)
    }
}

/// A scene of a case.
#[allow(clippy::large_enum_variant)] // One at a time.
enum Keeper {
    Cores(Scene),
    Gpu(GpuScene),
}

impl From<&Told> for Heard {
    fn from(told: &Told) -> Self {
        Self {
            begun: told.begun().to_vec(),
            ended: told.ended().iter().map(|ended| ended.pair).collect(),
            pairs: told.pairs().to_vec(),
            is_resync: told.is_resync(),
        }
    }
}

impl Keeper {
    fn ask(&mut self, steps: &[Step<'_>], want: Want, fate: Fate) -> Result<Heard, SceneError> {
        let edit = Edit { steps };
        let heard = match self {
            Self::Cores(scene) => scene.edit(edit, want)?.into(),
            Self::Gpu(scene) => scene.edit(edit, want)?.into(),
        };
        match self {
            _ if fate != Fate::Taken => {}
            Self::Cores(scene) => scene.take(),
            Self::Gpu(scene) => scene.take(),
        }
        Ok(heard)
    }
}

/// Scenes that the threads of a pool keep, or a GPU, where there are its tools. With `is_broken` a pair of most answers
/// is lost, to test that the checks notice.
pub(super) fn scenes(
    name: String,
    pool: Arc<ThreadPool>,
    tools: Option<Arc<SceneTools>>,
    is_broken: bool,
) -> Subject {
    let answer = move |case: &Case| {
        let mut random = Random::new(case.seed ^ STREAM);
        let mut scene = KeptScene::new(&mut random);
        let mut keeper = match &tools {
            None => Keeper::Cores(Scene::new(scene.options())),
            Some(tools) => Keeper::Gpu(GpuScene::new(tools, scene.options())),
        };
        for _ in 0..3 + random.below(4) {
            let edited = scene.edit(case, &mut random, |steps, want, fate| {
                let ask = || keeper.ask(steps, want, fate);
                let mut heard = case.flags.install(&pool, ask)?;
                if is_broken {
                    heard.begun.pop();
                }
                Ok((fate != Fate::Unread).then_some(heard))
            });
            match edited {
                Ok(checked) => checked?,
                Err(SceneError::Cull(CullError::TooCrowded { .. })) => return Ok(Reply::Declined),
                Err(error) => return Err(Finding::other(&error)),
            };
        }
        Ok(Reply::Right)
    };
    Subject { name, engine: "scenes", form: Form::Scene, answer: Box::new(answer) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_told_twice_or_never_is_noticed() {
        let mut scene = KeptScene::new(&mut Random::new(1));
        for (body, x) in scene.bodies.iter_mut().zip([0.0, 0.9, 1.8, 9.0]) {
            *body = Body { b: Aabb::from([x, 0.0, 0.0, x + 1.0, 1.0, 1.0]), ..NOBODY };
        }
        scene.known = BTreeSet::from([(0, 1), (0, 3)]);
        let right = Heard { begun: vec![[1, 2]], ended: vec![[0, 3]], ..Heard::default() };
        let mut check = |heard: &Heard, want| scene.check(heard, want, Fate::Dropped);
        assert_eq!(check(&right, Want::Changes), Ok(()));
        let spoils: [fn(&mut Heard); 6] = [
            |heard| heard.begun.clear(),
            |heard| heard.begun.push([0, 1]),
            |heard| heard.begun.push([2, 3]),
            |heard| heard.ended.clear(),
            |heard| heard.ended.push([2, 3]),
            |heard| heard.is_resync = true,
        ];
        for (number, spoil) in spoils.into_iter().enumerate() {
            let mut heard = right.clone();
            spoil(&mut heard);
            assert!(check(&heard, Want::Changes).is_err(), "{number}");
        }
        let all = Heard { pairs: vec![[0, 1], [1, 2]], is_resync: true, ..Heard::default() };
        assert_eq!((check(&all, Want::All), check(&all, Want::Changes)), (Ok(()), Ok(())));
        assert!(check(&Heard::default(), Want::All).is_err());
        scene.bodies[0].is_static = true;
        scene.bodies[1].is_static = true;
        assert!(scene.check(&all, Want::All, Fate::Taken).is_err());
    }
}
