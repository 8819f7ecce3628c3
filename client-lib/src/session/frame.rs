//! A frame: memory for objects, until it is submitted.

use std::sync::Arc;

use pairmask_core::aabb::Aabb;
use pairmask_core::filters::Rules;
use pairmask_core::objects::{ObjectForm, Objects};
use pairmask_core::precision::{Encoder, Precision};
use pairmask_core::sphere::Sphere;
use pairmask_core::units::BoxCount;
use pairmask_core::write::{BoxSource, par_write_boxes};
use pairmask_wire::{bytes_in_mut, entries_in, entries_in_mut};

use super::core::Core;
use super::error::Error;
use super::link::SharedFrame;
use super::pairs::PairMask;
use super::pending::Pending;
use super::settings::Backend;
use super::spares::{Shelf, Spares};
use super::submitted::Submitted;
use super::written::Written;

/// Memory for the objects of one frame: boxes ([`Aabb`]), bounding [spheres](Sphere), or boxes that are
/// [quantized](Quantized) while they are written.
///
/// [`write`](Frame::write) takes all boxes at once, from a slice or from arrays in other layouts.
/// [`boxes_mut`](Frame::boxes_mut) and [`spheres_mut`](Frame::spheres_mut) are plain slices in object order: index
/// them, hand chunks of them to rayon, or let [`update`](pairmask_core::update) write into them.
pub struct Frame<O: FrameObject = Aabb> {
    n: BoxCount,
    /// `None` once it is submitted.
    memory: Option<FrameMemory<O::Stored>>,
    written: Written,
    encoding: O::Encoding,
    core: Arc<Core>,
}

/// What a frame may hold: [`Aabb`], [`Sphere`] or [`Quantized`].
pub trait FrameObject: sealed::Object {}

/// Boxes that are written in the form of a [`Precision`]. Shared memory holds the narrow form alone; a frame in
/// process holds f32 boxes that are rounded in the same way, so that the answer is the same.
#[derive(Debug)]
pub enum Quantized {}

/// What is asked of a frame beside its pairs: [`Frame::submit_with`].
#[derive(Clone, Debug, Default)]
pub struct FrameOptions {
    /// Which boxes may be a pair at all: filter data for each box of the frame or for none, a table of collision
    /// filters, and lists of pairs. Where boxes are of several worlds, the mask has
    /// [the pairs of each](super::PairMask::pairs_of_world).
    ///
    /// Those behind the same [`Arc`] are sent to a daemon once, and not looked at again. Filters that change are another
    /// [`Arc`] ([`Arc::make_mut`] makes one).
    pub filters: Option<Arc<Rules>>,
    /// Two sets: only pairs of one of the first so many boxes and one of the others count.
    pub split_at: Option<usize>,
}

pub(super) mod sealed {
    use bytemuck::Pod;
    use pairmask_core::objects::Objects;

    use crate::session::spares::{Shelf, Spares};

    /// Objects as this process's own memory holds them.
    pub trait Stored: Pod + Default {
        /// They as input of an engine.
        fn as_objects(own: &[Self]) -> Objects<'_>;
        /// The shelf of spare buffers for them.
        fn spares(spares: &Spares) -> &Shelf<Vec<Self>>;
    }

    /// How frames hold a kind of object.
    pub trait Object {
        /// What this process's own memory holds.
        type Stored: Stored;
        /// What is needed to write an object.
        type Encoding;
    }
}
use sealed::{Object, Stored};

impl Stored for Aabb {
    fn as_objects(own: &[Self]) -> Objects<'_> {
        Objects::Boxes(own.into())
    }
    fn spares(spares: &Spares) -> &Shelf<Vec<Self>> {
        &spares.boxes
    }
}

impl Stored for Sphere {
    fn as_objects(own: &[Self]) -> Objects<'_> {
        Objects::Spheres(own)
    }
    fn spares(spares: &Spares) -> &Shelf<Vec<Self>> {
        &spares.spheres
    }
}

impl<O: Object> FrameObject for O {}

impl Object for Aabb {
    type Stored = Self;
    type Encoding = ();
}

impl Object for Sphere {
    type Stored = Self;
    type Encoding = ();
}

impl Object for Quantized {
    type Stored = Aabb;
    type Encoding = (Precision, Encoder);
}

/// Objects that lie in shared memory as in this process's own.
impl<O: FrameObject<Stored = O> + Stored> Frame<O> {
    fn objects(&self) -> &[O] {
        match &self.memory {
            Some(FrameMemory::Shared(shared)) => {
                entries_in(shared.loan.pages(), self.n).unwrap_or_default()
            }
            Some(FrameMemory::Own(objects)) => objects,
            None => &[],
        }
    }

    fn objects_mut(&mut self) -> &mut [O] {
        match &mut self.memory {
            Some(FrameMemory::Shared(shared)) => {
                entries_in_mut(shared.loan.pages_mut(), self.n).unwrap_or_default()
            }
            Some(FrameMemory::Own(objects)) => objects,
            None => &mut [],
        }
    }
}

/// Where the objects lie.
enum FrameMemory<T> {
    /// In shared memory, in the form of the frame.
    Shared(SharedFrame),
    /// In this process's memory. Boxes of a narrow form are kept as the f32 boxes that they stand
    /// for.
    Own(Vec<T>),
}

impl<O: FrameObject> std::fmt::Debug for Frame<O> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Frame")
            .field("n", &self.n)
            .field("is_shared", &self.is_shared())
            .finish_non_exhaustive()
    }
}

impl<O: FrameObject> Drop for Frame<O> {
    fn drop(&mut self) {
        if let Some(FrameMemory::Own(objects)) = self.memory.take() {
            O::Stored::spares(self.core.local().spares()).give(objects);
        }
    }
}

impl<O: FrameObject> Frame<O> {
    /// A frame of `n` objects, in shared memory or this process's own, as the backend asks.
    pub(super) fn new(
        core: &Arc<Core>,
        n: usize,
        written: Written,
        encoding: O::Encoding,
    ) -> Result<Self, Error> {
        let limit = u64::from(u32::MAX);
        let n = BoxCount::of_len(n).ok_or(Error::TooManyBoxes { n, limit })?;
        let shared = || {
            let room = match written.form {
                ObjectForm::Boxes(_) => core.room_for_rules(n),
                ObjectForm::Spheres => 0,
            };
            core.loan(&core.link()?, written.scene(n).payload_bytes() + room)
        };
        let own = || {
            let memory = O::Stored::spares(core.local().spares()).take_sized(n);
            memory.map(FrameMemory::Own).ok_or(Error::NoMemory { n: n.get() })
        };
        let memory = match core.settings().backend {
            Backend::InProcess => own()?,
            Backend::Daemon => FrameMemory::Shared(shared()?),
            Backend::Auto => match shared() {
                Ok(shared) => FrameMemory::Shared(shared),
                // Only the daemon has a GPU.
                Err(error @ Error::TooManyFrames) if core.settings().needs_gpu() => {
                    return Err(error);
                }
                Err(Error::TooManyFrames) => own()?,
                Err(error) => {
                    core.say_in_process(&error);
                    own()?
                }
            },
        };
        Ok(Self { n, memory: Some(memory), written, encoding, core: Arc::clone(core) })
    }

    /// Boxes or spheres in this frame.
    pub const fn n(&self) -> BoxCount {
        self.n
    }

    /// Whether they lie in shared memory.
    pub const fn is_shared(&self) -> bool {
        matches!(self.memory, Some(FrameMemory::Shared(_)))
    }

    /// Asks for the pairs. In process they are found before this returns.
    ///
    /// # Errors
    /// [`Error`]; the frame's memory is released then.
    pub fn submit(self) -> Result<Pending<PairMask>, Error> {
        self.submit_by(None)
    }

    /// As [`submit`](Self::submit), for frames of boxes with collision filters or of two sets.
    ///
    /// Boxes of several worlds are culled world by world unless the session asks for a dense or a sparse mask or for an
    /// engine of all pairs: one frame of thousands of small worlds takes a small part of the time of a frame for each.
    /// Filters go to a daemon with the boxes, 12 bytes a box, and once. A daemon keeps those that each session sent last.
    /// One that does not have them, because it was started anew, is sent them again while the frame is waited for.
    ///
    /// Of two sets, one that is small beside the other, up to a hundredth of it on two cores, is looked for in cells
    /// of the other one by a core. Else the whole frame is culled, and the pairs of one set are left out. The mask is one
    /// of the whole frame.
    ///
    /// ```
    /// use std::sync::Arc;
    ///
    /// use pairmask::filters::{Filter, FilterId, FilterTable, Rules, FilterData};
    /// use pairmask::{Aabb, Backend, FrameOptions, Session};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let mut session = Session::builder().backend(Backend::InProcess).connect()?;
    /// let mut rules = Rules::default();
    /// rules.table = FilterTable::new(&[Filter::new(1, 2), Filter::new(2, 3)])?;
    /// rules.filter_data = [0, 0, 1].map(|id| FilterData::default().with_filter(FilterId(id))).to_vec();
    /// let filtered = FrameOptions { filters: Some(Arc::new(rules)), ..Default::default() };
    /// let two_sets = FrameOptions { split_at: Some(1), ..Default::default() };
    ///
    /// let boxes = [Aabb::new([0.0; 3], [1.0; 3]); 3];
    /// for (options, pairs) in [(filtered, [[0, 2], [1, 2]]), (two_sets, [[0, 1], [0, 2]])] {
    ///     let mut frame = session.frame(3)?;
    ///     frame.write(&boxes)?;
    ///     assert_eq!(frame.submit_with(&options)?.wait()?.to_vec(), pairs);
    /// }
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`submit`](Self::submit); [`Error::FirstSet`] where there are fewer boxes, [`Error::FilterData`] and
    /// [`Error::Listed`] where filters are not those of so many boxes, [`Error::Unsupported`] for
    /// spheres, and for filters and sets at once. With [`Backend::Daemon`](super::Backend::Daemon),
    /// [`Error::TooManyListedPairs`].
    pub fn submit_with(mut self, options: &FrameOptions) -> Result<Pending<PairMask>, Error> {
        let FrameOptions { filters, split_at } = options;
        if self.written.form == ObjectForm::Spheres && (filters.is_some() || split_at.is_some()) {
            return Err(Error::Unsupported { what: "spheres with filters or in two sets" });
        }
        if filters.is_some() && split_at.is_some() {
            return Err(Error::Unsupported { what: "two sets with filters" });
        }
        if let Some(filters) = filters {
            let (filter_data, n) = (filters.filter_data.len(), self.n.get());
            if filter_data != 0 && filter_data != self.n.len() {
                return Err(Error::FilterData { filter_data, n });
            }
            if let Some(index) = filters.lists.beyond(n) {
                return Err(Error::Listed { index, n });
            }
        }
        if let Some(first) = *split_at {
            let counted = BoxCount::of_len(first).filter(|first| *first <= self.n);
            let n = self.n.get();
            self.written.first_set = Some(counted.ok_or(Error::FirstSet { first, n })?);
        }
        self.submit_by(filters.as_ref())
    }

    fn submit_by(mut self, filters: Option<&Arc<Rules>>) -> Result<Pending<PairMask>, Error> {
        match self.memory.take() {
            Some(FrameMemory::Shared(shared)) => {
                let kept = shared.slot.link().cached_rules();
                // Filters that let all boxes meet are none. Those that the daemon keeps were looked at.
                let matter = |filters: &&Arc<Rules>| {
                    kept.are_known(filters, self.n) || !filters.let_all_meet(self.n.len())
                };
                let filters = filters.filter(matter);
                let core = Arc::clone(&self.core);
                Submitted::send(shared, self.n, self.written, filters, core).map(Pending::new)
            }
            Some(FrameMemory::Own(objects)) => {
                let rules = filters.map(|filters| &**filters);
                let rules = rules.filter(|rules| !rules.let_all_meet(self.n.len()));
                let given = O::Stored::as_objects(&objects);
                let mask = self.core.local().cull(given, rules, self.written);
                self.memory = Some(FrameMemory::Own(objects));
                Ok(Pending::new(Submitted::Ready(mask?)))
            }
            None => Err(Error::TooManyFrames),
        }
    }

    /// Whether so many objects are as many as the frame has.
    fn check_count(&self, given: usize) -> Result<(), Error> {
        let n = self.n.get();
        if given == self.n.len() { Ok(()) } else { Err(Error::WrongCount { given, n }) }
    }
}

impl Frame {
    /// Writes every box: a slice of boxes, or a source of [`write`](pairmask_core::write), such as
    /// arrays of centres and half extents.
    ///
    /// Large frames are written past the caches and on the calling thread's rayon pool, which is
    /// faster than a copy into [`boxes_mut`](Self::boxes_mut).
    ///
    /// ```
    /// use pairmask::{Aabb, CenterHalf, MinMax, Session};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// # let mut session = Session::builder().backend(pairmask::Backend::InProcess).connect()?;
    /// let mut frame = session.frame(2)?;
    /// frame.write(&[Aabb::new([0.0; 3], [1.0; 3]), Aabb::new([1.0; 3], [2.0; 3])])?;
    ///
    /// let (centers, halves) = ([[0.5; 3], [1.5; 3]], [[0.5; 3]; 2]);
    /// frame.write(&CenterHalf::points(&centers, &halves))?;
    ///
    /// let (low, high) = ([0.0, 1.0], [1.0, 2.0]);
    /// frame.write(&MinMax::columns([&low; 3], [&high; 3]))?;
    /// assert_eq!(frame.submit()?.wait()?.count(), 1);
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`Error::WrongCount`] when `boxes` are not as many as the frame has: nothing is written then.
    pub fn write(&mut self, boxes: &(impl BoxSource + Sync + ?Sized)) -> Result<(), Error> {
        self.check_count(boxes.len())?;
        par_write_boxes(boxes, self.boxes_mut());
        Ok(())
    }

    /// The boxes, contents unspecified until written.
    pub fn boxes_mut(&mut self) -> &mut [Aabb] {
        self.objects_mut()
    }

    /// The boxes as written so far.
    pub fn boxes(&self) -> &[Aabb] {
        self.objects()
    }
}

impl Frame<Sphere> {
    /// The spheres, contents unspecified until written.
    pub fn spheres_mut(&mut self) -> &mut [Sphere] {
        self.objects_mut()
    }

    /// The spheres as written so far.
    pub fn spheres(&self) -> &[Sphere] {
        self.objects()
    }
}

impl Frame<Quantized> {
    /// The precision that the boxes are written with.
    pub const fn precision(&self) -> &Precision {
        &self.encoding.0
    }

    /// Writes box `index`. All boxes together are written faster by [`write`](Self::write).
    ///
    /// # Panics
    /// When there is no box of that index.
    #[inline]
    pub fn set(&mut self, index: usize, b: &Aabb) {
        let box_bytes = self.precision().form().box_bytes();
        let (encoder, n) = (&self.encoding.1, self.n);
        match &mut self.memory {
            Some(FrameMemory::Shared(shared)) => {
                let bytes = narrow_bytes(shared, self.written, n);
                encoder.write_one(b, &mut bytes[index * box_bytes..][..box_bytes]);
            }
            Some(FrameMemory::Own(boxes)) => {
                encoder.write_expanded(std::slice::from_ref(b), &mut boxes[index..=index]);
            }
            None => {}
        }
    }

    /// Writes every box, large scenes on the rayon pool: a slice, or a source of
    /// [`write`](pairmask_core::write).
    ///
    /// # Errors
    /// [`Error::WrongCount`] when `boxes` are not as many as the frame has: nothing is written then.
    pub fn write(&mut self, boxes: &(impl BoxSource + Sync + ?Sized)) -> Result<(), Error> {
        self.check_count(boxes.len())?;
        let encoder = &self.encoding.1;
        match &mut self.memory {
            Some(FrameMemory::Shared(shared)) => {
                encoder.write(boxes, narrow_bytes(shared, self.written, self.n));
            }
            Some(FrameMemory::Own(out)) => encoder.write_expanded(boxes, out),
            None => {}
        }
        Ok(())
    }
}

/// The bytes of boxes in a narrow form.
fn narrow_bytes(shared: &mut SharedFrame, written: Written, n: BoxCount) -> &mut [u8] {
    bytes_in_mut(shared.loan.pages_mut(), written.form.bytes(n)).unwrap_or_default()
}
