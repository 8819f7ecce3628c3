//! Worlds whose origin moves.

use pairmask_core::aabb::Aabb;
use pairmask_core::scene::{Edit, EditError, Report, Sets, Step};

use super::backend::{Scene, is_applied, replicas};
use crate::session::error::Error;

impl Scene {
    /// Moves all boxes by a vector, those that are disabled too, so that a world in f64 can have its origin near the
    /// player. No pair begins or ends: the scene is moved only if f32 holds every coordinate afterwards. That is so where
    /// boxes are multiples of some power of two, and the vector as well.
    ///
    /// Of a shared scene, it moves the boxes of this member: all members have to do so in one tick.
    ///
    /// It costs about a frame, and another one when changes are reported next.
    ///
    /// ```
    /// use pairmask::{Aabb, Backend, Report, SceneOptions, Session};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let mut session = Session::builder().backend(Backend::InProcess).connect()?;
    /// let mut scene = session.scene(SceneOptions::default())?;
    /// let at = |x: f32| Aabb::new([x; 3], [x + 1.0; 3]);
    /// drop(scene.edit().set(0, at(4_096.0)).set(1, at(4_096.5)).commit(Report::Changes)?);
    ///
    /// scene.shift_origin([-4_096.0; 3])?;
    /// assert_eq!(scene.get(1), Some(at(0.5)));
    /// assert!(scene.edit().commit(Report::Changes)?.begun().is_empty());
    /// assert!(scene.shift_origin([1e9, 0.0, 0.0]).is_err());
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`EditError::InexactShift`], where the scene is what it was; else as
    /// [`commit`](super::SceneEdit::commit). Where pairs are those of inflated boxes
    /// ([`with_near_pairs`](super::SceneOptions::with_near_pairs)), f32 has to hold those as well, which it rarely does: margins are
    /// rounded outward.
    pub fn shift_origin(&mut self, by: impl Into<[f32; 3]>) -> Result<(), Error> {
        let by = by.into();
        self.settle();
        let is_near = self.margins.as_ref().is_some_and(|margins| !margins.is_exact());
        let index_end = self.replicas().now.index_end();
        let (mut indices, mut boxes, mut inflated): (Vec<u32>, Vec<Aabb>, Vec<Aabb>) =
            Default::default();
        for index in 0..index_end {
            let Some(b) = self.get(index) else { continue };
            let (moved, is_exact) = b.moved(by);
            // The same, but for margins.
            let (sent, sent_is_exact) = self.inflated(index).unwrap_or(b).moved(by);
            if !is_exact || is_near && !sent_is_exact {
                return Err(EditError::InexactShift { index }.into());
            }
            indices.push(index);
            boxes.push(moved);
            inflated.push(sent);
        }
        if indices.is_empty() {
            return Ok(());
        }
        let set = |boxes| [Step::Set(Sets { indices: (&indices).into(), boxes })];
        let (sent, edit) = (set(&inflated), set(&boxes));
        let edit = Edit { steps: &edit };
        let Self { backend, margins, snapshots, index_limit, .. } = self;
        snapshots.note(edit, &replicas(backend, margins.as_deref()), *index_limit);
        let awaited = backend.begin(Edit { steps: &sent }, Report::Nothing, None);
        if is_applied(&awaited) {
            if let Some(margins) = margins {
                margins.shift(edit);
            }
            snapshots.note_applied(edit);
        }
        self.end(awaited?).map(drop)
    }
}
