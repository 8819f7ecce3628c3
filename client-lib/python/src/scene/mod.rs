//! Persistent scenes.
//!
//! ```text
//! edited    a scene with its edit under way, which borrows it
//! ops       what an edit does, collected until it is committed
//! edit, answer      the classes of an edit
//! asked     what a scene is asked
//! ```

mod answer;
mod asked;
mod edit;
mod edited;
mod ops;

use std::fs::File;
use std::io::BufWriter;
use std::path::PathBuf;
use std::sync::Arc;

use pairmask::cast::{Hits, Shapes};
use pairmask::{Scene, SnapshotId, Sphere};
use pyo3::prelude::*;
use pyo3::types::{PyRange, PyRangeMethods};

use self::answer::Indices;
use self::asked::{filter_data_of, filters, hits_of, rays, shapes};
pub use self::edit::{PyEdit, PyPendingAnswer};
pub use self::edited::Edited;
use crate::arrays::{Rows, numbers};
use crate::errors::{invalid, raised};
use crate::guarded::Guarded;
use crate::memory::Array;
use crate::rules::Part;

/// A box as an array (6), which Python may write.
fn box_array(found: pairmask::Aabb) -> Array {
    Array::writable(bytemuck::cast::<_, [f32; 6]>(found).map(|x| [x]).to_vec())
}

/// Boxes that stay from answer to answer, by indices of the client's own.
#[pyclass(frozen, name = "Scene", module = "pairmask")]
pub struct PyScene(pub Arc<Guarded<Edited>>);

impl PyScene {
    pub fn new(scene: Scene) -> Self {
        Self(Arc::new(Guarded::new(Edited::new(scene), "the scene was closed")))
    }

    /// Calls `f` with the scene, where no edit of it is under way. `f` is quick.
    fn with<R>(&self, py: Python<'_>, f: impl FnOnce(&mut Scene) -> R) -> PyResult<R> {
        self.0.with(py, |edited| edited.scene().map(f))?
    }

    /// The same while other Python threads run.
    fn with_detached<R: Send>(
        &self,
        py: Python<'_>,
        f: impl FnOnce(&mut Scene) -> Result<R, pairmask::Error> + Send,
    ) -> PyResult<R> {
        self.0.with_detached(py, |edited| f(edited.scene()?).map_err(raised))?
    }
}

#[pymethods]
impl PyScene {
    /// Begins an edit.
    fn edit(&self) -> PyEdit {
        PyEdit::new(Arc::clone(&self.0))
    }

    /// The box (6) of an index, also of a disabled one; of a shared scene, one of this member's. It is the box
    /// as it was set.
    fn get(&self, py: Python<'_>, index: u32) -> PyResult<Option<Array>> {
        self.with(py, |scene| scene.get(index).map(box_array))
    }

    fn __len__(&self, py: Python<'_>) -> PyResult<usize> {
        self.with(py, |scene| scene.len())
    }

    fn __bool__(&self) -> bool {
        true
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        match self.with(py, |scene| scene.len()) {
            Ok(n) => format!("<Scene of {n} boxes>"),
            Err(_) => "<Scene, closed or being edited>".to_owned(),
        }
    }

    /// Which boxes of the scene some other boxes (n, 6) overlap: rows (query, index), sorted. They have filter data as
    /// `SceneEdit.set_filter` gives them.
    #[pyo3(signature = (boxes, *, world=None, owner=None, filter=None, is_static=None))]
    fn query(
        &self,
        py: Python<'_>,
        boxes: Rows,
        world: Part<'_, '_>,
        owner: Part<'_, '_>,
        filter: Part<'_, '_>,
        is_static: Part<'_, '_>,
    ) -> PyResult<Array> {
        let boxes = boxes.boxes(py)?;
        let filter_data = filter_data_of(py, boxes.len(), [world, owner, filter, is_static])?;
        let found = self.with_detached(py, |scene| {
            let answer = scene.query_filtered(&boxes, filters(filter_data.as_deref()))?;
            Ok(answer.to_vec())
        })?;
        Ok(Array::read_only(found))
    }

    /// Which boxes rays hit: all, or so many of the `closest`. A ray begins at its origin and goes along its direction
    /// (n, 3), up to `most` times as far, as thick as a box with these half extents. One origin or direction may stand
    /// for all. Rows (query, index) and distances, by query, by distance in lengths of the direction, and then by index.
    #[pyo3(signature = (
        origins, directions, *, closest=None, most=None, half_extents=None,
        world=None, owner=None, filter=None, is_static=None
    ))]
    fn cast<'py>(
        &self,
        py: Python<'py>,
        origins: &Bound<'_, PyAny>,
        directions: &Bound<'_, PyAny>,
        closest: Option<u32>,
        most: Part<'_, '_>,
        half_extents: Part<'_, '_>,
        world: Part<'_, '_>,
        owner: Part<'_, '_>,
        filter: Part<'_, '_>,
        is_static: Part<'_, '_>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let rays = rays(py, (origins, directions, most, half_extents))?;
        let parts = [world, owner, filter, is_static];
        self.cast_shapes(py, Shapes::Rays(&rays), hits_of(closest), parts)
    }

    /// Which rays hit any box, as truth values (n): a shadow test. Rays are those of `cast`.
    #[pyo3(signature = (
        origins, directions, *, most=None, half_extents=None,
        world=None, owner=None, filter=None, is_static=None
    ))]
    fn is_hit(
        &self,
        py: Python<'_>,
        origins: &Bound<'_, PyAny>,
        directions: &Bound<'_, PyAny>,
        most: Part<'_, '_>,
        half_extents: Part<'_, '_>,
        world: Part<'_, '_>,
        owner: Part<'_, '_>,
        filter: Part<'_, '_>,
        is_static: Part<'_, '_>,
    ) -> PyResult<Array> {
        let rays = rays(py, (origins, directions, most, half_extents))?;
        let filter_data = filter_data_of(py, rays.len(), [world, owner, filter, is_static])?;
        let found = self.with_detached(py, |scene| {
            let filters = filters(filter_data.as_deref());
            scene.cast_filtered(Shapes::Rays(&rays), Hits::Any, filters)
        })?;
        let mut are_hit = vec![[false]; rays.len()];
        for hit in found.hits() {
            are_hit[hit.query as usize] = [true];
        }
        Ok(Array::read_only(are_hit))
    }

    /// The boxes nearest to points (n, 3): all, or so many of the `closest`, no farther than `radius`. Rows
    /// (query, index) and distances, by query, by distance, and then by index.
    #[pyo3(signature = (
        points, *, closest=None, radius=None, world=None, owner=None, filter=None, is_static=None
    ))]
    fn nearest<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'_, PyAny>,
        closest: Option<u32>,
        radius: Part<'_, '_>,
        world: Part<'_, '_>,
        owner: Part<'_, '_>,
        filter: Part<'_, '_>,
        is_static: Part<'_, '_>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let rows = imported!(py, "pairmask._convert", "balls")?.call1((points, radius))?;
        let spheres: Vec<Sphere> = shapes(py, &rows)?;
        let parts = [world, owner, filter, is_static];
        self.cast_shapes(py, Shapes::Spheres(&spheres), hits_of(closest), parts)
    }

    /// Saves the scene in a file: boxes, flags, filters and pair lists. `Session.load_scene` reads it.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        let file = BufWriter::new(File::create(path)?);
        self.with_detached(py, |scene| scene.save(file))
    }

    /// Moves all boxes by a vector (3). No pair begins or ends: where float32 does not hold every coordinate afterwards,
    /// a `PairmaskError`, and the scene is what it was.
    fn shift_origin(&self, py: Python<'_>, by: [f32; 3]) -> PyResult<()> {
        self.with_detached(py, |scene| scene.shift_origin(by))
    }

    /// The user data of indices, in an array of their shape, such as (n, 2) of pairs. That of a removed box stays until
    /// another has its index, or the scene goes back to a snapshot.
    fn user_data<'py>(
        &self,
        py: Python<'py>,
        indices: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let flat = imported!(py, "pairmask._convert", "flat_indices")?.call1((indices,))?;
        let (indices, shape): (Bound<'py, PyAny>, Bound<'py, PyAny>) = flat.extract()?;
        let indices: Vec<u32> = numbers(&indices)?;
        let of = |scene: &mut Scene| indices.iter().map(|i| [scene.user_data(*i)]).collect();
        let found: Vec<[u64; 1]> = self.with(py, of)?;
        Array::read_only(found).into_pyobject(py)?.call_method1("reshape", (shape,))
    }

    /// Takes a snapshot of the scene, and returns its number. From then on each edit copies what it changes.
    fn snapshot(&self, py: Python<'_>) -> PyResult<u64> {
        self.with_detached(py, |scene| scene.snapshot().map(SnapshotId::number))
    }

    /// Goes back to a snapshot: the same edits have the same answers again. No pair is reported for this.
    fn restore(&self, py: Python<'_>, snapshot: u64) -> PyResult<()> {
        self.with_detached(py, |scene| scene.restore(SnapshotId::from_number(snapshot)))
    }

    /// Forgets a snapshot.
    fn forget_snapshot(&self, py: Python<'_>, snapshot: u64) -> PyResult<()> {
        self.with_detached(py, |scene| scene.forget_snapshot(SnapshotId::from_number(snapshot)))
    }

    /// Requests a resync: the next changes are one.
    fn resync(&self, py: Python<'_>) -> PyResult<()> {
        self.with(py, Scene::resync)
    }

    /// The box (6) of an index as it was sent: inflated, where it has a margin.
    fn inflated(&self, py: Python<'_>, index: u32) -> PyResult<Option<Array>> {
        self.with(py, |scene| scene.inflated(index).map(box_array))
    }

    /// What margins have saved so far; `None` of a scene without.
    #[getter]
    fn margin_stats<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let class = imported!(py, "pairmask._answers", "MarginStats")?;
        let stats = self.with(py, |scene| scene.margin_stats())?;
        stats.map(|of| class.call1((of.edits, of.requests, of.set, of.sent))).transpose()
    }

    /// Bytes of the scene in this process.
    #[getter]
    fn allocated_bytes(&self, py: Python<'_>) -> PyResult<usize> {
        self.with(py, |scene| scene.allocated_bytes())
    }

    /// Bytes of it in the daemon, by its last answer; 0 where it has none.
    #[getter]
    fn daemon_bytes(&self, py: Python<'_>) -> PyResult<u64> {
        self.with(py, |scene| scene.daemon_bytes())
    }

    /// Indices are below this.
    #[getter]
    fn most_boxes(&self, py: Python<'_>) -> PyResult<u32> {
        self.with(py, |scene| scene.most_boxes())
    }

    /// Leases a `range` of indices of a shared scene: this member alone may set boxes there.
    fn lease(&self, py: Python<'_>, indices: &Bound<'_, PyRange>) -> PyResult<()> {
        let part = |name| indices.getattr(name)?.extract::<u32>();
        let range = part("start")?..part("stop")?;
        if indices.step()? != 1 {
            return Err(invalid("a lease is a range without gaps"));
        }
        self.with_detached(py, |scene| scene.lease(range))
    }

    /// Leases the lowest free range of so many indices.
    fn lease_any(&self, py: Python<'_>, count: u32) -> PyResult<Indices> {
        self.with_detached(py, |scene| scene.lease_any(count).map(Indices))
    }

    /// Gives back the lease that begins at an index. Its boxes are removed.
    fn give_back(&self, py: Python<'_>, first: u32) -> PyResult<()> {
        self.with_detached(py, |scene| scene.give_back(first))
    }

    /// The ranges of a shared scene that this member has leased.
    #[getter]
    fn leases(&self, py: Python<'_>) -> PyResult<Vec<Indices>> {
        self.with(py, |scene| scene.leases().iter().cloned().map(Indices).collect())
    }

    /// How long a tick of a shared scene is open after its first commit, at the most, seconds.
    #[getter]
    fn tick_deadline(&self, py: Python<'_>) -> PyResult<Option<f64>> {
        self.with(py, |scene| scene.tick_deadline().map(|deadline| deadline.as_secs_f64()))
    }

    /// Ends the scene; a shared one is left. The answer to an edit under way is discarded.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.0.close(py)
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (*_args))]
    fn __exit__(&self, py: Python<'_>, _args: &Bound<'_, PyAny>) -> PyResult<()> {
        self.close(py)
    }
}
