//! An edit of a scene that is being written.

use pairmask_core::aabb::Aabb;
use pairmask_core::filters::{FilterData, FilterTable};
use pairmask_core::precision::Margin;
use pairmask_core::scene::{
    EditError, FilterDataSets, Given, Indices, MarginedSets, Margins, Report, Sets, Step,
    UserDataSets,
};

use super::answer::{SceneAnswer, Submitted};
use super::backend::Scene;
use crate::session::error::Error;
use crate::session::pending::Pending;

/// An edit that is being written: see [`Edit`](pairmask_core::scene::Edit) for the order in which it is applied, and
/// [`EditError`] for what is wrong.
#[derive(Debug)]
#[must_use = "an edit does nothing until it is committed"]
pub struct SceneEdit<'s, 'a> {
    scene: &'s mut Scene,
    given: Given<'a>,
    /// What is wrong with it so far.
    refused: Option<EditError>,
}

impl Scene {
    /// Begins an edit. Without [`SceneEdit::commit`], nothing happens.
    pub fn edit<'a>(&mut self) -> SceneEdit<'_, 'a> {
        self.draft.clear();
        SceneEdit { scene: self, given: Given::default(), refused: None }
    }
}

impl<'s, 'a> SceneEdit<'s, 'a> {
    /// Sets the box of an index; inserts it where there is none. In a scene with margins it has the usual one.
    pub fn set(self, index: u32, b: Aabb) -> Self {
        let margin = self.scene.margins.as_ref().map(|margins| margins.usual());
        self.set_one(index, b, margin)
    }

    /// As [`set`](Self::set), with a margin of its own. A scene without margins knows that of 0 alone.
    pub fn set_margined(mut self, index: u32, b: Aabb, margin: Margin) -> Self {
        let margin = self.own_margins(margin.into()).map(|()| margin);
        self.set_one(index, b, margin)
    }

    fn set_one(self, index: u32, b: Aabb, margin: Option<Margin>) -> Self {
        self.scene.draft.indices.push(index);
        self.scene.draft.boxes.push(b);
        self.scene.draft.margins.extend(margin);
        self
    }

    /// Sets boxes where they lie: a list of indices, a range or a [bitmask](Indices::Mask), and
    /// a box for each.
    pub fn set_all(self, indices: impl Into<Indices<'a>>, boxes: &'a [Aabb]) -> Self {
        self.step(Step::Set(Sets { indices: indices.into(), boxes }))
    }

    /// As [`set_all`](Self::set_all), with a margin for each box, or one for all.
    pub fn set_all_margined(
        mut self,
        indices: impl Into<Indices<'a>>,
        boxes: &'a [Aabb],
        margins: impl Into<Margins<'a>>,
    ) -> Self {
        let (indices, margins) = (indices.into(), margins.into());
        let sets = MarginedSets { indices, boxes, margins };
        self.refused = self.refused.or(sets.check().err());
        if self.own_margins(margins).is_none() {
            return self.step(sets.step());
        }
        self.given.margined.push(sets);
        self
    }

    /// Whether boxes have these margins. A scene without any refuses all but those of 0.
    fn own_margins(&mut self, margins: Margins<'_>) -> Option<()> {
        if self.scene.margins.is_some() {
            return Some(());
        }
        self.refused = self.refused.or((!margins.are_zero()).then_some(EditError::NoMargins));
        None
    }

    /// Sets boxes to what a function gives for each index, in the order in which they are named.
    ///
    /// It is the better way where the boxes lie in no array: where they are computed from bodies, or gathered
    /// from several places. They are written once, to memory that the scene keeps for the next such edit (24
    /// bytes for each box of the largest one), and are copied from there as those of
    /// [`set_all`](Self::set_all) are from the caller's array. Boxes that lie in an array already are one copy
    /// cheaper with `set_all`.
    ///
    /// With an index that the scene cannot have, the function is not called, and the edit is refused when it
    /// is committed.
    ///
    /// ```
    /// use pairmask::{Aabb, Backend, Report, SceneOptions, Session};
    ///
    /// let bodies: Vec<([f32; 3], f32)> = vec![([0.0; 3], 1.0), ([1.5; 3], 1.0), ([9.0; 3], 1.0)];
    /// let mut session = Session::builder().backend(Backend::InProcess).connect()?;
    /// let mut scene = session.scene(SceneOptions::default())?;
    /// let edit = scene.edit().set_with(0..3, |index| {
    ///     let (centre, half) = bodies[index as usize];
    ///     Aabb::new(centre.map(|x| x - half), centre.map(|x| x + half))
    /// });
    /// assert_eq!(edit.commit(Report::Changes)?.begun(), [[0, 1]]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn set_with(mut self, indices: impl Into<Indices<'a>>, f: impl FnMut(u32) -> Aabb) -> Self {
        let (indices, limit) = (indices.into(), self.scene.index_limit);
        match self.scene.draft.fill(indices, limit, f) {
            Ok(slot) => self.given.fills.push((indices, slot)),
            Err(error) => self.refused = self.refused.or(Some(error)),
        }
        self
    }

    /// Removes the box of an index.
    pub fn remove(self, index: u32) -> Self {
        self.scene.draft.removed.push(index);
        self
    }

    /// Removes boxes.
    pub fn remove_all(self, indices: impl Into<Indices<'a>>) -> Self {
        self.step(Step::Remove(indices.into()))
    }

    /// Disables a box (it overlaps nothing) or enables it.
    pub fn set_enabled(self, index: u32, is_enabled: bool) -> Self {
        self.step(Step::Enable(one(index), is_enabled))
    }

    /// Disables boxes or enables them.
    pub fn set_all_enabled(self, indices: impl Into<Indices<'a>>, is_enabled: bool) -> Self {
        self.step(Step::Enable(indices.into(), is_enabled))
    }

    /// Makes a box static (two static boxes are no pair) or not.
    pub fn make_static(self, index: u32, is_static: bool) -> Self {
        self.step(Step::Static(one(index), is_static))
    }

    /// Makes boxes static or not.
    pub fn make_all_static(self, indices: impl Into<Indices<'a>>, is_static: bool) -> Self {
        self.step(Step::Static(indices.into(), is_static))
    }

    /// Gives a box its [filter data](pairmask_core::filters): its world, its owner and its filter. A box that is
    /// inserted has [`FilterData::default`]. [`make_static`](Self::make_static) says whether a box itself is static, and
    /// not its filter data.
    pub fn set_filter(self, index: u32, filter_data: FilterData) -> Self {
        self.scene.draft.filtered.push(index);
        self.scene.draft.filter_data.push(filter_data);
        self
    }

    /// Gives boxes their filter data, as [`set_filter`](Self::set_filter) does.
    pub fn set_all_filters(
        self,
        indices: impl Into<Indices<'a>>,
        filter_data: &'a [FilterData],
    ) -> Self {
        self.step(Step::FilterData(FilterDataSets { indices: indices.into(), filter_data }))
    }

    /// Gives a box user data: a number of the program's own, such as the index of a body. It changes nothing that is
    /// reported. [`Scene::user_data`] returns it, of a shared scene that of other members' boxes too. A box that is
    /// inserted has 0.
    ///
    /// ```
    /// use pairmask::{Aabb, Backend, Report, SceneOptions, Session};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let mut session = Session::builder().backend(Backend::InProcess).connect()?;
    /// let mut scene = session.scene(SceneOptions::default())?;
    /// let at = |x: f32| Aabb::new([x; 3], [x + 1.0; 3]);
    /// let edit = scene.edit().set(3, at(0.0)).set(7, at(0.5)).set_all_user_data(&[3, 7], &[100, 200]);
    /// let answer = edit.commit(Report::Changes)?;
    /// let bodies = answer.begun().iter().map(|pair| pair.map(|i| answer.scene().user_data(i)));
    /// assert_eq!(bodies.collect::<Vec<_>>(), [[100, 200]]);
    /// # Ok(())
    /// # }
    /// ```
    pub fn set_user_data(self, index: u32, user_data: u64) -> Self {
        self.scene.draft.marked.push(index);
        self.scene.draft.user_data.push(user_data.into());
        self
    }

    /// Gives boxes user data, as [`set_user_data`](Self::set_user_data) does.
    pub fn set_all_user_data(self, indices: impl Into<Indices<'a>>, user_data: &'a [u64]) -> Self {
        let (indices, user_data) = (indices.into(), bytemuck::cast_slice(user_data));
        self.step(Step::UserData(UserDataSets { indices, user_data }))
    }

    /// The filters that filter data names, in place of all before.
    pub fn filter_table(self, table: &'a FilterTable) -> Self {
        self.step(Step::Filters(table))
    }

    /// Puts pairs on the include list, or takes them off.
    pub fn include(self, pairs: &'a [[u32; 2]], on: bool) -> Self {
        self.step(Step::Include(pairs, on))
    }

    /// Puts pairs on the exclude list, or takes them off.
    pub fn exclude(self, pairs: &'a [[u32; 2]], on: bool) -> Self {
        self.step(Step::Exclude(pairs, on))
    }

    /// Does a step.
    pub fn step(mut self, step: Step<'a>) -> Self {
        self.given.steps.push(step);
        self
    }

    /// Applies the edit and answers.
    ///
    /// # Errors
    /// [`Error`], of which [`is_applied`](Error::is_applied) says whether the scene has the edit.
    pub fn commit(self, report: Report) -> Result<SceneAnswer<'s>, Error> {
        self.submit(report)?.wait()
    }

    /// Sends the edit. The daemon works on it while this thread does something else; in process it is
    /// answered before this returns.
    ///
    /// # Errors
    /// [`Error`], of which [`is_applied`](Error::is_applied) says whether the scene has the edit.
    pub fn submit(self, report: Report) -> Result<Pending<SceneAnswer<'s>>, Error> {
        let Self { scene, given, refused } = self;
        if let Some(error) = refused {
            return Err(error.into());
        }
        let (asked, awaited) = scene.begin(&given, report)?;
        Ok(Pending::new(Submitted { scene, report, asked, awaited }))
    }
}

/// A single index.
const fn one(index: u32) -> Indices<'static> {
    Indices::Range { first: index, count: 1 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Backend, SceneOptions, Session};

    #[test]
    fn steady_fills_allocate_no_boxes() {
        let session = Session::builder().backend(Backend::InProcess).connect();
        let mut session = session.expect("no daemon is needed");
        let mut scene = session.scene(SceneOptions::default()).expect("a scene");
        let mut fill = |step: usize| {
            let at = |index: u32| Aabb::new([index as f32; 3], [index as f32 + step as f32; 3]);
            let edit = scene.edit().set_with(0..600, at).set_with(600..1_000, at);
            drop(edit.commit(Report::Nothing).expect("an answer"));
            assert_eq!(scene.get(999), Some(at(999)));
            (scene.draft.filled.as_ptr(), scene.draft.filled.capacity())
        };
        let first = fill(0);
        assert!((1..20).all(|step| fill(step) == first));
    }
}
