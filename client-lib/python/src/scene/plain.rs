//! Scenes of one session.

use pairmask::Scene;
use pairmask::filters::Tag;
use pyo3::prelude::*;

use super::PyAnyScene;
use super::any::AnyScene;
use crate::errors::Raise;
use crate::memory::Memory;
use crate::rules::{Part, TagParts};
use crate::sources::Boxes;

/// Boxes that persist from answer to answer, by indices of the client's own.
#[pyclass(frozen, extends = PyAnyScene, name = "Scene", module = "pairmask")]
pub struct PyScene;

impl PyScene {
    pub fn new(py: Python<'_>, scene: Scene) -> PyResult<Py<Self>> {
        PyAnyScene::of(py, AnyScene::Plain(scene), Self)
    }
}

#[pymethods]
impl PyScene {
    /// Which boxes of the scene some other boxes overlap: rows (query, index), sorted.
    #[pyo3(signature = (boxes, *, world=None, owner=None, filter=None, is_static=None))]
    fn query<'py>(
        slf: &Bound<'py, Self>,
        boxes: &Bound<'py, PyAny>,
        world: Part<'_, 'py>,
        owner: Part<'_, 'py>,
        filter: Part<'_, 'py>,
        is_static: Part<'_, 'py>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let boxes = Boxes::of_some(boxes)?.to_vec(slf.py())?;
        let parts = TagParts { world, owner, filter, is_static };
        let tags: Option<Vec<Tag>> =
            if parts.are_none() { None } else { Some(parts.tags(boxes.len())?) };
        let found = slf.as_super().get().with_detached(slf.py(), |scene| {
            let query = scene.plain()?.query(&boxes);
            let query = match &tags {
                Some(tags) => query.tags(tags),
                None => query,
            };
            query.find().map(|answer| answer.to_vec()).map_err(Raise::raise)
        })?;
        Memory::of_rows(found).into_array(slf.py())
    }

    /// Forgets what was told: the next changes are a resync.
    fn lose(slf: &Bound<'_, Self>) -> PyResult<()> {
        slf.as_super().get().with(slf.py(), |scene| {
            scene.plain()?.lose();
            Ok(())
        })
    }

    /// Bytes that this process keeps of the scene.
    #[getter]
    fn allocated_bytes(slf: &Bound<'_, Self>) -> PyResult<usize> {
        slf.as_super().get().with(slf.py(), |scene| Ok(scene.plain()?.allocated_bytes()))
    }

    /// Bytes that the daemon keeps of it, by its last answer; 0 where it has none.
    #[getter]
    fn daemon_bytes(slf: &Bound<'_, Self>) -> PyResult<u64> {
        slf.as_super().get().with(slf.py(), |scene| Ok(scene.plain()?.daemon_bytes()))
    }
}
