//! A frame being filled.

use std::sync::Arc;

use bytemuck::Pod;
use pairmask_core::aabb::Aabb;
use pairmask_core::filters::Rules;
use pairmask_core::objects::{ObjectForm, Objects};
use pairmask_core::precision::{Precision, Widening};
use pairmask_core::sphere::Sphere;
use pairmask_core::units::BoxCount;
use pairmask_core::write::{BoxSource, par_write_boxes};
use pairmask_wire::{
    Page, QUERIES_MINOR, ScenePlace, boxes_in, boxes_in_mut, bytes_in_mut, since_minor, spheres_in,
    spheres_in_mut,
};

use super::core::Core;
use super::error::FrameError;
use super::kept_rules::FrameRules;
use super::link::SharedFrame;
use super::local::Spares;
use super::pending::PendingFrame;

/// Memory for the boxes of one frame.
///
/// [`write`](Frame::write) takes all boxes at once, from a slice or from arrays in other layouts.
/// [`boxes_mut`](Frame::boxes_mut) is a plain slice in object order: index it, iterate it, hand
/// chunks of it to rayon, or let [`update`](pairmask_core::update) write into it.
#[derive(Debug)]
pub struct Frame {
    filling: Filling<Aabb>,
}

/// The form in which the objects of a frame are written, and the extra pairs that it may add.
#[derive(Clone, Copy, Debug)]
pub(super) struct Written {
    pub form: ObjectForm,
    pub widening: Widening,
    /// So many boxes are set A, and the others set B; `None` where all pairs count.
    pub first_set: Option<BoxCount>,
}

impl Written {
    /// Spheres, exact.
    pub(super) const SPHERES: Self =
        Self { form: ObjectForm::Spheres, widening: Widening::None, first_set: None };

    /// Boxes written with a precision.
    pub(super) fn by(precision: &Precision) -> Self {
        let (form, widening) = (precision.form().into(), precision.widening());
        Self { form, widening, first_set: None }
    }

    /// Where all of it lies in the memory of a frame of `n` objects.
    pub(super) fn scene(self, n: BoxCount) -> ScenePlace {
        ScenePlace::first(self.form, n)
    }

    /// Minor wire version from which daemons know all of it.
    pub(super) const fn since_minor(self) -> u16 {
        match self.first_set {
            Some(_) => QUERIES_MINOR,
            None => since_minor(self.form),
        }
    }
}

/// A kind of object that frames are filled with: boxes or spheres.
pub(super) trait Object: Pod + Default {
    /// The first `n` objects of a payload.
    fn in_pages(pages: &[Page], n: BoxCount) -> Option<&[Self]>;
    /// As [`in_pages`](Self::in_pages), writable.
    fn in_pages_mut(pages: &mut [Page], n: BoxCount) -> Option<&mut [Self]>;
    /// Objects in this process's memory as input of an engine.
    fn as_objects(own: &[Self]) -> Objects<'_>;
    /// The shelf of spare buffers for these objects.
    fn spares(spares: &Spares) -> &super::local::Shelf<Vec<Self>>;
}

impl Object for Aabb {
    fn in_pages(pages: &[Page], n: BoxCount) -> Option<&[Self]> {
        boxes_in(pages, 0, n)
    }
    fn in_pages_mut(pages: &mut [Page], n: BoxCount) -> Option<&mut [Self]> {
        boxes_in_mut(pages, n)
    }
    fn as_objects(own: &[Self]) -> Objects<'_> {
        Objects::Boxes(own.into())
    }
    fn spares(spares: &Spares) -> &super::local::Shelf<Vec<Self>> {
        &spares.boxes
    }
}

impl Object for Sphere {
    fn in_pages(pages: &[Page], n: BoxCount) -> Option<&[Self]> {
        spheres_in(pages, 0, n)
    }
    fn in_pages_mut(pages: &mut [Page], n: BoxCount) -> Option<&mut [Self]> {
        spheres_in_mut(pages, n)
    }
    fn as_objects(own: &[Self]) -> Objects<'_> {
        Objects::Spheres(own)
    }
    fn spares(spares: &Spares) -> &super::local::Shelf<Vec<Self>> {
        &spares.spheres
    }
}

/// Where the objects lie.
pub(super) enum FrameMemory<T> {
    /// In shared memory, in the form of the frame.
    Shared(SharedFrame),
    /// In this process's memory. Boxes of a narrow form are kept as the f32 boxes that they stand
    /// for.
    Own(Vec<T>),
}

/// Memory that boxes of a narrow form are written into.
pub(super) enum NarrowMemory<'a> {
    /// Bytes in the narrow form.
    Bytes(&'a mut [u8]),
    /// The f32 boxes that the narrow ones stand for.
    Expanded(&'a mut [Aabb]),
}

/// A frame of boxes or of spheres, until it is submitted.
pub(super) struct Filling<T: Object> {
    n: BoxCount,
    /// `None` once it is submitted.
    memory: Option<FrameMemory<T>>,
    written: Written,
    core: Arc<Core>,
}

impl<T: Object> std::fmt::Debug for Filling<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Filling")
            .field("n", &self.n)
            .field("is_shared", &self.is_shared())
            .finish_non_exhaustive()
    }
}

impl<T: Object> Filling<T> {
    pub(super) const fn new(
        n: BoxCount,
        memory: FrameMemory<T>,
        written: Written,
        core: Arc<Core>,
    ) -> Self {
        Self { n, memory: Some(memory), written, core }
    }

    pub(super) const fn n(&self) -> BoxCount {
        self.n
    }

    pub(super) const fn is_shared(&self) -> bool {
        matches!(self.memory, Some(FrameMemory::Shared(_)))
    }

    pub(super) fn objects_mut(&mut self) -> &mut [T] {
        match &mut self.memory {
            Some(FrameMemory::Shared(shared)) => {
                T::in_pages_mut(shared.loan.pages_mut(), self.n).unwrap_or_default()
            }
            Some(FrameMemory::Own(objects)) => objects,
            None => &mut [],
        }
    }

    pub(super) fn objects(&self) -> &[T] {
        match &self.memory {
            Some(FrameMemory::Shared(shared)) => {
                T::in_pages(shared.loan.pages(), self.n).unwrap_or_default()
            }
            Some(FrameMemory::Own(objects)) => objects,
            None => &[],
        }
    }

    pub(super) fn submit(self) -> Result<PendingFrame, FrameError> {
        self.submit_by(None)
    }

    fn submit_by(mut self, rules: Option<FrameRules<'_>>) -> Result<PendingFrame, FrameError> {
        match self.memory.take() {
            Some(FrameMemory::Shared(shared)) => {
                PendingFrame::send(shared, self.n, self.written, rules, Arc::clone(&self.core))
            }
            Some(FrameMemory::Own(objects)) => {
                let rules = rules.map(|of| of.rules);
                let mask = self.core.cull_here(T::as_objects(&objects), rules, self.written);
                self.memory = Some(FrameMemory::Own(objects));
                Ok(PendingFrame::ready(mask?, Arc::clone(&self.core)))
            }
            None => Err(FrameError::TooManyFrames),
        }
    }
}

impl<T: Object> Drop for Filling<T> {
    fn drop(&mut self) {
        if let Some(FrameMemory::Own(objects)) = self.memory.take() {
            T::spares(self.core.spares()).give(objects);
        }
    }
}

impl Filling<Aabb> {
    /// Asks for the pairs that rules let meet. Rules that let all meet are none.
    pub(super) fn submit_with(self, rules: &Rules) -> Result<PendingFrame, FrameError> {
        let rules = (!rules.let_all_meet(self.n.len())).then_some(rules);
        self.submit_by(rules.map(|rules| FrameRules { rules, kept: None }))
    }

    /// The same with rules that the daemon keeps.
    pub(super) fn submit_with_kept(self, rules: &Arc<Rules>) -> Result<PendingFrame, FrameError> {
        let are_known = match &self.memory {
            Some(FrameMemory::Shared(shared)) => {
                shared.slot.link().kept_rules().are_known(rules, self.n)
            }
            _ => false,
        };
        let matter = are_known || !rules.let_all_meet(self.n.len());
        self.submit_by(matter.then_some(FrameRules { rules, kept: Some(rules) }))
    }

    /// Finds the pairs of a box of the first `first` and one of the others.
    pub(super) fn submit_between(mut self, first: BoxCount) -> Result<PendingFrame, FrameError> {
        if first > self.n {
            return Err(FrameError::FirstSet { first: first.get(), n: self.n.get() });
        }
        self.written.first_set = Some(first);
        self.submit()
    }

    /// The memory of a frame whose boxes are written in a narrow form.
    pub(super) fn narrow_memory(&mut self) -> NarrowMemory<'_> {
        match &mut self.memory {
            Some(FrameMemory::Shared(shared)) => {
                let bytes = bytes_in_mut(shared.loan.pages_mut(), self.written.form.bytes(self.n));
                NarrowMemory::Bytes(bytes.unwrap_or_default())
            }
            Some(FrameMemory::Own(boxes)) => NarrowMemory::Expanded(boxes),
            None => NarrowMemory::Bytes(&mut []),
        }
    }
}

impl Frame {
    pub(super) const fn new(filling: Filling<Aabb>) -> Self {
        Self { filling }
    }

    /// Boxes in this frame.
    pub const fn n(&self) -> BoxCount {
        self.filling.n()
    }

    /// Whether the boxes lie in shared memory.
    pub const fn is_shared(&self) -> bool {
        self.filling.is_shared()
    }

    /// Writes every box: a slice of boxes, or a source of [`write`](pairmask_core::write), such as
    /// arrays of centres and half extents.
    ///
    /// Large frames are written past the caches and on the calling thread's rayon pool, which is
    /// faster than a copy into [`boxes_mut`](Self::boxes_mut).
    ///
    /// ```
    /// use pairmask::write::{CenterHalf, MinMax};
    /// use pairmask::{Aabb, Session};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// # let mut session = Session::builder().backend(pairmask::Backend::InProcess).connect()?;
    /// let mut frame = session.frame(2)?;
    /// frame.write(&[Aabb::new([0.0; 3], [1.0; 3]), Aabb::new([1.0; 3], [2.0; 3])]);
    ///
    /// let (centers, halves) = ([[0.5; 3], [1.5; 3]], [[0.5; 3]; 2]);
    /// frame.write(&CenterHalf::points(&centers, &halves));
    ///
    /// let (low, high) = ([0.0, 1.0], [1.0, 2.0]);
    /// frame.write(&MinMax::columns([&low; 3], [&high; 3]));
    /// assert_eq!(frame.submit()?.wait()?.count(), 1);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Panics
    /// When `boxes` are not as many as the frame has.
    pub fn write(&mut self, boxes: &(impl BoxSource + Sync + ?Sized)) {
        assert_eq!(boxes.len(), self.n().len(), "as many boxes as the frame has");
        par_write_boxes(boxes, self.boxes_mut());
    }

    /// The boxes, contents unspecified until written.
    pub fn boxes_mut(&mut self) -> &mut [Aabb] {
        self.filling.objects_mut()
    }

    /// The boxes as written so far.
    pub fn boxes(&self) -> &[Aabb] {
        self.filling.objects()
    }

    /// The boxes as six floats each: `min.x min.y min.z max.x max.y max.z`.
    pub fn raw_mut(&mut self) -> &mut [[f32; 6]] {
        bytemuck::cast_slice_mut(self.boxes_mut())
    }

    /// Asks for the pairs. In process they are found before this returns.
    ///
    /// # Errors
    /// [`FrameError`]; the frame's memory is gone then.
    pub fn submit(self) -> Result<PendingFrame, FrameError> {
        self.filling.submit()
    }

    /// Asks for the pairs of two sets: the first `first` boxes against all others. Boxes of one set are no
    /// pair. The mask is one of the whole frame.
    ///
    /// A set that is small beside the other one, up to a hundredth of it on two cores, is looked for in cells of
    /// the other one by a core, whichever of the CPU's engines the session names. Else an engine culls the whole
    /// frame, a GPU's too, and the pairs of one set are left out: that takes about as long as the whole frame.
    ///
    /// ```
    /// use pairmask::{Aabb, Backend, BoxCount, Session};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let mut session = Session::builder().backend(Backend::InProcess).connect()?;
    /// let mut frame = session.frame(4)?;
    /// frame.boxes_mut().fill(Aabb::new([0.0; 3], [1.0; 3]));
    /// let mask = frame.submit_between(BoxCount::new(1))?.wait()?;
    /// assert_eq!(mask.to_vec(), [(0, 1), (0, 2), (0, 3)]);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`submit`](Self::submit), and [`FrameError::FirstSet`] where there are fewer boxes.
    pub fn submit_between(self, first: BoxCount) -> Result<PendingFrame, FrameError> {
        self.filling.submit_between(first)
    }

    /// Asks for the pairs that rules let meet: tags by index of the boxes, filters, and lists. In process
    /// they are found before this returns.
    ///
    /// Boxes of several worlds are culled world by world unless the session insists on a dense or a sparse
    /// mask or on an engine of all pairs, and the pairs of each are [found by
    /// it](super::PairMask::pairs_of_world). One frame of thousands of small worlds takes a small part of
    /// the time that a frame for each of them would.
    ///
    /// Rules go to a daemon with the boxes, 12 bytes a tag; those that stay for many frames need not
    /// ([`submit_with_kept`](Self::submit_with_kept)). A session's first frame with rules moves its
    /// boxes to memory that has room for both; the memory of later ones has it from the beginning. Rules
    /// that are equal to those of the frame before are only compared, and rules that let all boxes meet
    /// are not sent.
    ///
    /// ```
    /// use pairmask::filters::{Filter, FilterId, FilterTable, Rules, Tag};
    /// use pairmask::{Aabb, Backend, Session};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let mut session = Session::builder().backend(Backend::InProcess).connect()?;
    /// let mut rules = Rules::default();
    /// rules.table = FilterTable::new(&[Filter::new(1, 2), Filter::new(2, 3)])?;
    /// rules.tags = [0, 0, 1].map(|id| Tag::default().with_filter(FilterId(id))).to_vec();
    ///
    /// let mut frame = session.frame(3)?;
    /// frame.boxes_mut().fill(Aabb::new([0.0; 3], [1.0; 3]));
    /// let mask = frame.submit_with(&rules)?.wait()?;
    /// assert!(mask.contains(0, 2) && mask.contains(1, 2) && mask.count() == 2);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`submit`](Self::submit). With [`Backend::Daemon`](super::Backend::Daemon),
    /// [`FrameError::DaemonTooOld`] where the daemon knows no rules, and
    /// [`FrameError::TooManyListedPairs`].
    pub fn submit_with(self, rules: &Rules) -> Result<PendingFrame, FrameError> {
        self.filling.submit_with(rules)
    }

    /// As [`submit_with`](Self::submit_with), for rules that stay: those behind the same [`Arc`] are sent
    /// to a daemon once, and not looked at again. Rules that change are another [`Arc`]
    /// ([`Arc::make_mut`] makes one).
    ///
    /// A daemon keeps the rules that each session sent last. One that does not have them, because it was
    /// started anew, is sent them again while the frame is waited for.
    ///
    /// ```
    /// use std::sync::Arc;
    ///
    /// use pairmask::filters::{Owner, Rules, Tag};
    /// use pairmask::{Aabb, Backend, Session};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let mut session = Session::builder().backend(Backend::InProcess).connect()?;
    /// let mut rules = Rules::default();
    /// rules.tags = [7, 7, 8].map(|owner| Tag::default().with_owner(Owner(owner))).to_vec();
    /// let rules = Arc::new(rules);
    /// for _ in 0..3 {
    ///     let mut frame = session.frame(3)?;
    ///     frame.boxes_mut().fill(Aabb::new([0.0; 3], [1.0; 3]));
    ///     let mask = frame.submit_with_kept(&rules)?.wait()?;
    ///     assert!(mask.contains(0, 2) && mask.contains(1, 2) && mask.count() == 2);
    /// }
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`submit_with`](Self::submit_with).
    pub fn submit_with_kept(self, rules: &Arc<Rules>) -> Result<PendingFrame, FrameError> {
        self.filling.submit_with_kept(rules)
    }
}
