//! Scenes that are saved, and loaded again.

use std::io::{Read, Write};

use pairmask_core::scene::{Edit, Report};
use pairmask_wire::{SceneFile, write_scene};

use super::backend::Scene;
use super::edit::SceneEdit;
use crate::session::error::Error;

impl Scene {
    /// Saves the scene as the last edit made it: boxes as they were set, flags, filters, pair lists and user data; of a
    /// shared scene, those of this member. [`Session::load_scene`](crate::Session::load_scene) reads it. What was reported is not saved.
    ///
    /// ```
    /// use pairmask::{Aabb, Backend, Report, SceneOptions, Session};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let mut session = Session::builder().backend(Backend::InProcess).connect()?;
    /// let mut scene = session.scene(SceneOptions::default())?;
    /// let at = |x: f32| Aabb::new([x; 3], [x + 1.0; 3]);
    /// drop(scene.edit().set(7, at(0.0)).set(9, at(0.5)).commit(Report::Changes)?);
    ///
    /// let mut file = Vec::new();
    /// scene.save(&mut file)?;
    /// let mut loaded = session.load_scene(SceneOptions::default(), &file[..])?;
    /// assert_eq!(loaded.get(9), Some(at(0.5)));
    /// assert_eq!(loaded.edit().commit(Report::Changes)?.begun(), [[7, 9]]);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`Error::SceneFile`].
    pub fn save(&mut self, mut to: impl Write) -> Result<(), Error> {
        self.settle();
        let whole = self.replicas().now.whole();
        Ok(write_scene(Edit { steps: &whole.steps() }, &mut to)?)
    }

    /// Makes a saved scene in this one, which has no boxes.
    pub(in crate::session) fn load(&mut self, from: &mut dyn Read) -> Result<(), Error> {
        let file = SceneFile::read(from, self.index_limit)?;
        let steps = file.steps()?;
        let edit = steps.iter().copied().fold(self.edit(), SceneEdit::step);
        edit.commit(Report::Nothing).map(drop)
    }
}
