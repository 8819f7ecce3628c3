//! A scene of any kind, and an edit of it from its steps to what it told.

use pairmask::scene::{SceneSkips, Want};
use pairmask::{
    Aabb, MarginedScene, PendingAnswer, PendingMargined, PendingShared, Scene, SceneEdit, ServedBy,
    SharedEdit, SharedScene,
};
use pyo3::PyResult;

use super::answer::{Read, read};
use super::ops::{Op, margined};
use crate::errors::{Raise, misused};

/// A scene of any kind.
#[allow(clippy::large_enum_variant)] // It is boxed.
pub enum AnyScene {
    Plain(Scene),
    Margined(MarginedScene),
    Shared(SharedScene),
}

/// An edit under way.
pub enum Pending<'s> {
    Plain(PendingAnswer<'s, 's>),
    Margined(PendingMargined<'s>),
    Shared(PendingShared<'s>),
}

/// The same of a scene of any kind.
macro_rules! of_any {
    ($scene:expr, $name:ident => $value:expr) => {
        match $scene {
            AnyScene::Plain($name) => $value,
            AnyScene::Margined($name) => $value,
            AnyScene::Shared($name) => $value,
        }
    };
}

/// The scene of one kind. A class of Python calls the one that it was made of, so that none fails.
macro_rules! only {
    ($scene:expr, $kind:ident) => {
        match $scene {
            AnyScene::$kind(scene) => Ok(scene),
            _ => Err(misused("the scene is of another kind", "Kind")),
        }
    };
}

impl AnyScene {
    pub fn plain(&mut self) -> PyResult<&mut Scene> {
        only!(self, Plain)
    }

    pub fn margined(&mut self) -> PyResult<&mut MarginedScene> {
        only!(self, Margined)
    }

    pub fn shared(&mut self) -> PyResult<&mut SharedScene> {
        only!(self, Shared)
    }

    pub const fn len(&self) -> usize {
        of_any!(self, scene => scene.len())
    }

    pub fn get(&self, index: u32) -> Option<Aabb> {
        of_any!(self, scene => scene.get(index))
    }

    /// Applies an edit, and sends it where a daemon has the scene.
    pub fn submit<'s>(&'s mut self, ops: &'s [Op], want: Want) -> PyResult<Pending<'s>> {
        let steps = ops.iter().map(Op::step);
        Ok(match self {
            Self::Plain(scene) => {
                let edit = steps.fold(scene.edit(), SceneEdit::step);
                Pending::Plain(edit.submit(want).map_err(Raise::raise)?)
            }
            Self::Margined(scene) => {
                let edit = ops.iter().fold(scene.edit(), margined);
                Pending::Margined(edit.submit(want).map_err(Raise::raise)?)
            }
            Self::Shared(scene) => {
                let edit = steps.fold(scene.edit(), SharedEdit::step);
                Pending::Shared(edit.submit(want).map_err(Raise::raise)?)
            }
        })
    }
}

/// Pairs that were not tested.
const fn skipped_pairs(skips: &SceneSkips) -> u64 {
    let SceneSkips { static_pairs, unmoved_pairs, cell_pairs, .. } = *skips;
    static_pairs.saturating_add(unmoved_pairs).saturating_add(cell_pairs)
}

impl Pending<'_> {
    /// Waits for the answer, takes it where that is asked for, and reads it.
    pub fn wait(self, take: bool) -> PyResult<Read> {
        Ok(match self {
            Self::Plain(pending) => {
                let answer = pending.wait().map_err(Raise::raise)?;
                let answer = if take { answer.take() } else { answer };
                Read {
                    served_by: Some(answer.served_by().as_str()),
                    engine: Some(answer.engine().to_string()),
                    skipped_pairs: Some(skipped_pairs(answer.skipped())),
                    ..read!(answer)
                }
            }
            Self::Margined(pending) => {
                let answer = pending.wait().map_err(Raise::raise)?;
                let answer = if take { answer.take() } else { answer };
                Read { served_by: answer.served_by().map(ServedBy::as_str), ..read!(answer) }
            }
            Self::Shared(pending) => {
                let answer = pending.wait().map_err(Raise::raise)?;
                let answer = if take { answer.take() } else { answer };
                Read {
                    served_by: Some(ServedBy::Daemon.as_str()),
                    engine: Some(answer.engine().to_string()),
                    skipped_pairs: Some(skipped_pairs(answer.skipped())),
                    tick: Some(answer.tick()),
                    late: answer.late(),
                    ..read!(answer)
                }
            }
        })
    }
}
