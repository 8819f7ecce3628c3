//! Sessions.

use std::ffi::CString;
use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::{Duration, Instant};

use pairmask::{
    AtEnd, Backend, Error, FrameOptions, Margin, PairMask, Pending, Scene, SceneOptions, Scope,
    Session, SessionBuilder,
};
use pairmask_core::units::BoxCount;
use pyo3::exceptions::PyRuntimeWarning;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};

use crate::arrays::Rows;
use crate::errors::{invalid, raised};
use crate::frame::{AnyFrame, PyFrame, seconds};
use crate::guarded::Guarded;
use crate::memory::Array;
use crate::pairs::pairs_of;
use crate::precision::PyPrecision;
use crate::process;
use crate::rules::PyRules;
use crate::scene::{Edited, PyScene};

/// What a name of Python stands for.
pub fn one_of<T: Copy>(name: &str, known: &[(&str, T)]) -> PyResult<T> {
    let found = known.iter().find(|(known, _)| *known == name);
    found.map(|(_, value)| *value).ok_or_else(|| {
        let names: Vec<&str> = known.iter().map(|(known, _)| *known).collect();
        invalid(format!("'{name}' is none of these: {}", names.join(", ")))
    })
}

/// A margin of boxes, units.
pub fn margin(units: f32) -> PyResult<Margin> {
    Margin::new(units).map_err(invalid)
}

/// A connection to a daemon or to the engines of this process.
#[pyclass(frozen, name = "Session", module = "pairmask")]
pub struct PySession {
    session: Guarded<Session>,
    scenes: Mutex<Vec<Weak<Guarded<Edited>>>>,
}

/// The options of a scene of this session alone.
fn options_of(
    most_boxes: Option<u32>,
    threads: Option<usize>,
    margins: Option<&str>,
    usual_margin: f32,
) -> PyResult<SceneOptions> {
    let mut options = SceneOptions::default();
    options.most_boxes = most_boxes;
    options.threads = threads;
    if let Some(name) = margins {
        let near_pairs = one_of(name, &[("exact", false), ("near", true)])?;
        options = options.with_margin(margin(usual_margin)?).with_near_pairs(near_pairs);
    }
    Ok(options)
}

#[pymethods]
impl PySession {
    #[new]
    #[pyo3(signature = (
        backend="auto", *, instance=None, runtime_dir=None, engine="auto", encoding="auto", threads=None,
        iterate_threads=None, answer_repeats=true, isa=None, spin=None, deadline=None, capacity=None,
    ))]
    fn new(
        py: Python<'_>,
        backend: &str,
        instance: Option<&str>,
        runtime_dir: Option<PathBuf>,
        engine: &str,
        encoding: &str,
        threads: Option<usize>,
        iterate_threads: Option<usize>,
        answer_repeats: bool,
        isa: Option<&str>,
        spin: Option<f64>,
        deadline: Option<f64>,
        capacity: Option<u32>,
    ) -> PyResult<Self> {
        process::check()?;
        let builder = Session::builder()
            .backend(backend.parse::<Backend>().map_err(invalid)?)
            .engine(engine.parse().map_err(invalid)?)
            .encoding(encoding.parse().map_err(invalid)?)
            .answer_repeats(answer_repeats);
        // Each option that is given is folded into the builder.
        let builder = instance.into_iter().fold(builder, SessionBuilder::instance);
        let builder = runtime_dir.into_iter().fold(builder, SessionBuilder::runtime_dir);
        let builder = threads.into_iter().fold(builder, SessionBuilder::threads);
        let builder = iterate_threads.into_iter().fold(builder, SessionBuilder::iterate_threads);
        let isa = isa.map(|name| name.parse().map_err(invalid)).transpose()?;
        let builder = isa.into_iter().fold(builder, SessionBuilder::isa);
        let spin = spin.map(seconds).transpose()?;
        let builder = spin.into_iter().fold(builder, SessionBuilder::spin);
        let deadline = deadline.map(seconds).transpose()?;
        let builder = deadline.into_iter().fold(builder, SessionBuilder::deadline);
        let capacity = capacity.map(BoxCount::new);
        let builder = capacity.into_iter().fold(builder, SessionBuilder::capacity);
        let session = py.detach(|| builder.connect()).map_err(|error| raised(error.into()))?;
        let session = Guarded::new(session, "the session was closed");
        Ok(Self { session, scenes: Mutex::default() })
    }

    /// Memory for the boxes (n, 6) of a frame.
    fn frame(&self, py: Python<'_>, n: usize) -> PyResult<PyFrame> {
        self.begin(py, |session| session.frame(n).map(AnyFrame::Boxes))
    }

    /// Memory for the boxes (n, 6) of a frame that are written with a precision.
    fn narrow_frame(&self, py: Python<'_>, n: usize, precision: &PyPrecision) -> PyResult<PyFrame> {
        let precision = precision.0;
        self.begin(py, |session| session.narrow_frame(n, precision).map(AnyFrame::Quantized))
    }

    /// Memory for the spheres (n, 4) of a frame.
    fn sphere_frame(&self, py: Python<'_>, n: usize) -> PyResult<PyFrame> {
        self.begin(py, |session| session.sphere_frame(n).map(AnyFrame::Spheres))
    }

    /// The pairs (count, 2) of boxes (n, 6): a frame from its memory to its pairs, in one call. Where frames and masks
    /// hold all of the session's slots at a daemon, it waits for one, as long as the deadline allows.
    #[pyo3(signature = (boxes, rules=None))]
    fn cull(&self, py: Python<'_>, boxes: Rows, rules: Option<&PyRules>) -> PyResult<Array> {
        let n = boxes.len();
        let mut frame = self.begin_in_time(py, |session| session.frame(n))?;
        boxes.write(py, frame.boxes_mut())?;
        let options =
            FrameOptions { filters: rules.map(|rules| Arc::clone(&rules.0)), ..Default::default() };
        pairs_after(py, || frame.submit_with(&options))
    }

    /// The pairs (count, 2) of spheres (n, 4), `x y z radius` a row.
    fn cull_spheres(&self, py: Python<'_>, spheres: &Bound<'_, PyAny>) -> PyResult<Array> {
        let rows = Rows::of(spheres, 4)?;
        let n = rows.len();
        let mut frame = self.begin_in_time(py, |session| session.sphere_frame(n))?;
        rows.write(py, frame.spheres_mut())?;
        pairs_after(py, || frame.submit())
    }

    /// A persistent scene: edits go in, pairs that began and ended come out. With `margins`, "exact" or "near",
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
        let options = options_of(most_boxes, threads, margins, usual_margin)?;
        let scene = self.session.with_detached(py, move |session| session.scene(options))?;
        scene.map(|scene| self.own(scene)).map_err(raised)
    }

    /// A scene that `Scene.save` has written to a file. Its boxes begin with the next changes.
    #[pyo3(signature = (path, *, most_boxes=None, threads=None, margins=None, usual_margin=0.0))]
    fn load_scene(
        &self,
        py: Python<'_>,
        path: PathBuf,
        most_boxes: Option<u32>,
        threads: Option<usize>,
        margins: Option<&str>,
        usual_margin: f32,
    ) -> PyResult<PyScene> {
        let options = options_of(most_boxes, threads, margins, usual_margin)?;
        let file = BufReader::new(File::open(path)?);
        let load = move |session: &mut Session| session.load_scene(options, file);
        self.session.with_detached(py, load)?.map(|scene| self.own(scene)).map_err(raised)
    }

    /// Joins a scene that several processes write, each its own boxes, by its name. `tick_deadline` (seconds; 0.1 unless
    /// a member sets it): how long a tick waits for writers. `at_end`, "remove" or "keep": what becomes of the boxes of a
    /// writer that ends. `scope`, "own" or "all": which pairs are reported. With a `usual_margin`, boxes are sent only
    /// when they have left theirs, and pairs are near ones. The first answer, and the one after a lease, is a resync:
    /// `pairs`, not `begun`.
    #[pyo3(signature = (
        name, *, most_boxes=None, tick_deadline=None, at_end=None, scope="own", usual_margin=None
    ))]
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
        let ends = [("remove", AtEnd::Remove), ("keep", AtEnd::Keep)];
        let mut options = SceneOptions::default().with_shared(name);
        options.most_boxes = most_boxes;
        options.tick_deadline = tick_deadline.map(seconds).transpose()?;
        options.at_end = at_end.map(|name| one_of(name, &ends)).transpose()?;
        options.scope = one_of(scope, &[("own", Scope::Own), ("all", Scope::All)])?;
        options.margin = usual_margin.map(margin).transpose()?;
        let scene = self.session.with_detached(py, move |session| session.scene(options))?;
        scene.map(|scene| self.own(scene)).map_err(raised)
    }

    /// What would serve the next frame: `daemon` or `in-process`.
    fn served_by(&self, py: Python<'_>) -> PyResult<&'static str> {
        self.session.with_detached(py, |session| session.served_by().as_str())
    }

    /// The daemon's status, by name.
    fn daemon_status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let status = self.session.with_detached(py, Session::daemon_status)?.map_err(raised)?;
        let numbers = [
            ("pid", u64::from(status.pid)),
            ("clients", u64::from(status.client_count)),
            ("uptime_ns", status.uptime_ns),
            ("frames", status.frames),
            ("boxes", status.boxes),
            ("spheres", status.spheres),
            ("pairs", status.pairs),
            ("errors", status.errors),
            ("scenes", status.scenes.into()),
            ("scene_mib", status.scene_mib.into()),
        ];
        numbers.into_py_dict(py)
    }

    /// Ends the session and its scenes. Frames, masks and arrays live on.
    fn close(&self, py: Python<'_>) -> PyResult<()> {
        let scenes =
            std::mem::take(&mut *self.scenes.lock().unwrap_or_else(PoisonError::into_inner));
        scenes.iter().filter_map(Weak::upgrade).try_for_each(|scene| scene.close(py))?;
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
    fn own(&self, scene: Scene) -> PyScene {
        let scene = PyScene::new(scene);
        let mut scenes = self.scenes.lock().unwrap_or_else(PoisonError::into_inner);
        scenes.retain(|scene| scene.strong_count() > 0);
        scenes.push(Arc::downgrade(&scene.0));
        scene
    }

    fn begin(
        &self,
        py: Python<'_>,
        f: impl FnOnce(&mut Session) -> Result<AnyFrame, Error> + Send,
    ) -> PyResult<PyFrame> {
        self.session.with_detached(py, f)?.map(PyFrame::new).map_err(raised)
    }

    /// Memory for a frame. Where frames and masks hold all of the session's slots at a daemon, waits for one.
    fn begin_in_time<F: Send>(
        &self,
        py: Python<'_>,
        f: impl Fn(&mut Session) -> Result<F, Error> + Send + Copy,
    ) -> PyResult<F> {
        let until =
            Instant::now() + self.session.with_detached(py, |session| session.deadline())?;
        loop {
            match self.session.with_detached(py, f)? {
                Err(Error::TooManyFrames) if Instant::now() < until => {
                    py.check_signals()?;
                    py.detach(|| std::thread::sleep(SLOT_INTERVAL));
                }
                begun => return begun.map_err(raised),
            }
        }
    }
}

/// How often to look for a free slot where frames and masks hold all: about the time of a small frame.
const SLOT_INTERVAL: Duration = Duration::from_micros(50);

/// Submits a frame, waits and decodes while other Python threads run.
fn pairs_after(
    py: Python<'_>,
    submit: impl FnOnce() -> Result<Pending<PairMask>, Error> + Send,
) -> PyResult<Array> {
    let (pairs, census) = py.detach(|| {
        let mask = submit().and_then(Pending::wait).map_err(raised)?;
        Ok::<_, PyErr>((pairs_of(&mask), mask.info().census))
    })?;
    if census.invalid > 0 {
        let (count, first) = (census.invalid, census.first_invalid[0]);
        let text =
            format!("{count} boxes or spheres are invalid and overlap nothing: {first} first");
        let text = CString::new(text).unwrap_or_default();
        PyErr::warn(py, &py.get_type::<PyRuntimeWarning>(), &text, 1)?;
    }
    Ok(Array::read_only(pairs))
}
