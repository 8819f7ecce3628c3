//! Sessions.

use std::ffi::CString;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use pairmask::{Backend, Error, FrameOptions, PendingFrame, Precision, Scene, Session};
use pairmask_core::engine::UnknownName;
use pairmask_core::units::BoxCount;
use pyo3::exceptions::{PyRuntimeWarning, PyValueError};
use pyo3::prelude::*;

use crate::arrays::Rows;
use crate::errors::Raise;
use crate::frame::{PyFrame, seconds};
use crate::guarded::Guarded;
use crate::memory::Memory;
use crate::pairs::pairs_of;
use crate::precision::PyPrecision;
use crate::process;
use crate::rules::PyRules;
use crate::scene::{OpenScene, PyScene, join_options, scene_options};
use crate::sources::Boxes;

/// Parses a name that an option has.
fn named<T: std::str::FromStr<Err = UnknownName>>(name: &str) -> PyResult<T> {
    name.parse().map_err(Raise::raise)
}

/// A connection to a daemon or to the engines of this process.
#[pyclass(frozen, name = "Session", module = "pairmask")]
pub struct PySession {
    session: Guarded<Session>,
    scenes: Mutex<Vec<OpenScene>>,
}

#[pymethods]
impl PySession {
    #[new]
    #[pyo3(signature = (
        backend="auto", *, instance=None, runtime_dir=None, engine="auto", encoding="auto", threads=None,
        visit_threads=None, answer_repeats=true, isa=None, spin=None, deadline=None, capacity=None,
    ))]
    #[allow(clippy::too_many_arguments)] // Python has them by name.
    fn new(
        py: Python<'_>,
        backend: &str,
        instance: Option<&str>,
        runtime_dir: Option<PathBuf>,
        engine: &str,
        encoding: &str,
        threads: Option<usize>,
        visit_threads: Option<usize>,
        answer_repeats: bool,
        isa: Option<&str>,
        spin: Option<f64>,
        deadline: Option<f64>,
        capacity: Option<u32>,
    ) -> PyResult<Self> {
        process::check()?;
        let mut builder = Session::builder()
            .backend(named::<Backend>(backend)?)
            .engine(named(engine)?)
            .encoding(named(encoding)?)
            .answer_repeats(answer_repeats);
        if let Some(instance) = instance {
            builder = builder.instance(instance);
        }
        if let Some(dir) = runtime_dir {
            builder = builder.runtime_dir(dir);
        }
        if let Some(threads) = threads {
            builder = builder.threads(threads);
        }
        if let Some(threads) = visit_threads {
            builder = builder.visit_threads(threads);
        }
        if let Some(isa) = isa {
            let isa = isa.parse();
            let refused =
                |error: pairmask_core::engine::IsaError| PyValueError::new_err(error.to_string());
            builder = builder.isa(isa.map_err(refused)?);
        }
        if let Some(spin) = spin {
            builder = builder.spin(seconds(spin)?);
        }
        if let Some(deadline) = deadline {
            builder = builder.deadline(seconds(deadline)?);
        }
        if let Some(capacity) = capacity {
            builder = builder.capacity(BoxCount::new(capacity));
        }
        let session = py.detach(|| builder.connect()).map_err(Raise::raise)?;
        let session = Guarded::new(session, "the session was closed");
        Ok(Self { session, scenes: Mutex::default() })
    }

    /// Memory for the boxes of a frame of `n` boxes.
    fn frame(&self, py: Python<'_>, n: usize) -> PyResult<PyFrame> {
        self.begin(py, move |session| session.frame(n)).map(PyFrame::of_boxes)
    }

    /// Memory for the boxes of a frame that are written with a precision.
    fn narrow_frame(&self, py: Python<'_>, n: usize, precision: &PyPrecision) -> PyResult<PyFrame> {
        let precision: Precision = precision.precision;
        let begin = move |session: &mut Session| session.narrow_frame(n, precision);
        self.begin(py, begin).map(PyFrame::of_quantized)
    }

    /// Memory for the spheres of a frame.
    fn sphere_frame(&self, py: Python<'_>, n: usize) -> PyResult<PyFrame> {
        self.begin(py, move |session| session.sphere_frame(n)).map(PyFrame::of_spheres)
    }

    /// The pairs of an array of boxes: a frame from its memory to its pairs, in one call. Where frames
    /// and masks hold all of the session's places at a daemon, it waits for one, as long as the deadline allows.
    #[pyo3(signature = (boxes, rules=None))]
    fn cull<'py>(
        &self,
        py: Python<'py>,
        boxes: &Bound<'py, PyAny>,
        rules: Option<&PyRules>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let boxes = Boxes::of(boxes)?;
        let n = boxes.len();
        let mut frame = self.begin_in_time(py, |session| session.frame(n))?;
        boxes.write(py, frame.boxes_mut())?;
        let options = FrameOptions { filters: rules.map(PyRules::shared), ..Default::default() };
        pairs_after(py, || frame.submit_with(&options))
    }

    /// The pairs of an array of spheres.
    fn cull_spheres<'py>(
        &self,
        py: Python<'py>,
        spheres: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let rows = Rows::of(spheres, 4)?;
        let n = rows.len();
        let mut frame = self.begin_in_time(py, |session| session.sphere_frame(n))?;
        rows.write_spheres(py, frame.spheres_mut())?;
        pairs_after(py, || frame.submit())
    }

    /// A scene that persists: edits go in, pairs that began and ended come out. With `margins`, "exact" or "near",
    /// boxes are sent only when they have left theirs.
    #[pyo3(signature = (*, most_boxes=None, threads=None, margins=None, usual_margin=0.0))]
    fn scene(
        &self,
        py: Python<'_>,
        most_boxes: Option<u32>,
        threads: Option<usize>,
        margins: Option<&str>,
        usual_margin: f32,
    ) -> PyResult<PyScene> {
        let options = scene_options(most_boxes, threads, margins, usual_margin)?;
        self.with(py, move |session| session.scene(options)).map(|scene| self.keep(scene))
    }

    /// Joins a scene that several processes write, each its own boxes, by its name. `tick_deadline` (seconds; 0.1 unless
    /// a member says so): how long a tick waits for writers. `at_end`, "remove" or "keep": what becomes of the boxes of a
    /// writer that ends. `scope`, "own" or "all": which pairs are reported. With a `usual_margin`, boxes are sent only
    /// when they have left theirs, and pairs are near ones. The first answer, and the one after a lease, is a resync:
    /// `pairs`, not `begun`.
    #[pyo3(signature = (
        name, *, most_boxes=None, tick_deadline=None, at_end=None, scope="own", usual_margin=None
    ))]
    #[allow(clippy::too_many_arguments)] // They are Python's keywords.
    fn join_scene(
        &self,
        py: Python<'_>,
        name: &str,
        most_boxes: Option<u32>,
        tick_deadline: Option<f64>,
        at_end: Option<&str>,
        scope: &str,
        usual_margin: Option<f32>,
    ) -> PyResult<PyScene> {
        let options = join_options(most_boxes, tick_deadline, at_end, scope, usual_margin)?;
        let scene = self.with(py, move |session| session.join_scene(name, options))?;
        scene.map(|scene| self.keep(scene)).map_err(Raise::raise)
    }

    /// What would serve the next frame: `daemon` or `in-process`.
    fn served_by(&self, py: Python<'_>) -> PyResult<&'static str> {
        self.with(py, |session| session.served_by().as_str())
    }

    /// The daemon's status, by name.
    fn daemon_status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, pyo3::types::PyDict>> {
        let status = self.with(py, Session::daemon_status)?.map_err(Raise::raise)?;
        let reported = pyo3::types::PyDict::new(py);
        reported.set_item("pid", status.pid)?;
        reported.set_item("clients", status.client_count)?;
        reported.set_item("uptime_ns", status.uptime_ns)?;
        reported.set_item("frames", status.frames)?;
        reported.set_item("boxes", status.boxes)?;
        reported.set_item("spheres", status.spheres)?;
        reported.set_item("pairs", status.pairs)?;
        reported.set_item("errors", status.errors)?;
        reported.set_item("scenes", status.scenes)?;
        reported.set_item("scene_mib", status.scene_mib)?;
        Ok(reported)
    }

    /// Ends the session and its scenes. Frames, masks and arrays live on.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        let scenes =
            std::mem::take(&mut *self.scenes.lock().unwrap_or_else(PoisonError::into_inner));
        scenes.iter().try_for_each(|scene| scene.close(py))?;
        self.session.close(py)
    }

    fn __repr__(&self, py: Python<'_>) -> String {
        let served_by = self.served_by(py);
        served_by.map_or_else(|_| "<Session, closed>".to_owned(), |by| format!("<Session, {by}>"))
    }

    fn __enter__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (*_args))]
    fn __exit__(&self, py: Python<'_>, _args: &Bound<'_, PyAny>) -> PyResult<()> {
        self.close(py)
    }
}

impl PySession {
    /// A new scene, which ends with the session.
    fn keep(&self, scene: Scene) -> PyScene {
        let scene = PyScene::new(scene);
        let mut scenes = self.scenes.lock().unwrap_or_else(PoisonError::into_inner);
        scenes.retain(OpenScene::is_there);
        scenes.push(scene.open());
        scene
    }

    fn with<R: Send>(
        &self,
        py: Python<'_>,
        f: impl FnOnce(&mut Session) -> R + Send,
    ) -> PyResult<R> {
        self.session.with_detached(py, f)
    }

    /// Memory for a frame.
    fn begin<F: Send>(
        &self,
        py: Python<'_>,
        f: impl FnOnce(&mut Session) -> Result<F, Error> + Send,
    ) -> PyResult<F> {
        self.with(py, f)?.map_err(Raise::raise)
    }

    /// Memory for a frame. Where frames and masks hold all of the session's places at a daemon, waits for one.
    fn begin_in_time<F: Send>(
        &self,
        py: Python<'_>,
        f: impl Fn(&mut Session) -> Result<F, Error> + Send + Copy,
    ) -> PyResult<F> {
        let until = Instant::now() + self.with(py, |session| session.deadline())?;
        loop {
            match self.with(py, f)? {
                Err(Error::TooManyFrames) if Instant::now() < until => {
                    py.check_signals()?;
                    py.detach(|| std::thread::sleep(PLACE_INTERVAL));
                }
                begun => return begun.map_err(Raise::raise),
            }
        }
    }
}

/// A place for a frame that others hold is looked for this often: about the time of a small frame.
const PLACE_INTERVAL: Duration = Duration::from_micros(50);

/// Submits a frame, waits and decodes while other Python threads run.
fn pairs_after(
    py: Python<'_>,
    submit: impl FnOnce() -> Result<PendingFrame, Error> + Send,
) -> PyResult<Bound<'_, PyAny>> {
    let (pairs, census) = py.detach(|| {
        let pending = submit().map_err(Raise::raise)?;
        let mask = pending.wait().map_err(Raise::raise)?;
        Ok::<_, PyErr>((pairs_of(&mask), mask.info().census))
    })?;
    if census.invalid > 0 {
        let (count, first) = (census.invalid, census.first_invalid[0]);
        let text =
            format!("{count} boxes or spheres are invalid and overlap nothing: {first} first");
        let text = CString::new(text).unwrap_or_default();
        PyErr::warn(py, &py.get_type::<PyRuntimeWarning>(), &text, 1)?;
    }
    Memory::of_rows(pairs).into_array(py)
}
