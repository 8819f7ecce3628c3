//! Sessions: one API over the daemon through shared memory and over the engines in process.

mod builder;
mod core;
mod error;
mod frame;
#[cfg_attr(not(feature = "daemon"), path = "absent.rs")]
pub(crate) mod link;
mod local;
mod pairs;
mod pending;
mod scene;
mod settings;
mod spares;
mod submitted;
#[cfg_attr(not(feature = "daemon"), allow(dead_code))]
mod unread;
mod written;

pub use builder::SessionBuilder;
pub use error::{ConnectError, Error};
pub use frame::{Frame, FrameObject, FrameOptions, Quantized};
pub use pairs::{FrameInfo, PairMask, ServedBy};
pub use pending::Pending;
pub use scene::{HitAnswer, QueryAnswer, Scene, SceneAnswer, SceneEdit, SceneOptions};
pub use settings::Backend;

use std::sync::Arc;
use std::time::Duration;

use pairmask_core::precision::{Encoder, Precision};
use pairmask_core::sphere::Sphere;
use pairmask_wire::StatusBody;

use self::written::Written;

/// A client's connection to a daemon or to the engines of this process.
///
/// A session may be moved between threads, and its pending frames may be awaited on others.
#[derive(Debug)]
pub struct Session {
    core: Arc<core::Core>,
}

impl SessionBuilder {
    /// Makes the session.
    ///
    /// # Errors
    /// [`ConnectError`]. With [`Backend::Auto`] a missing daemon is no error.
    pub fn connect(self) -> Result<Session, ConnectError> {
        Ok(Session { core: Arc::new(core::Core::new(self.settings()?)?) })
    }
}

impl Session {
    /// Begins the description of a session; [`connect`](SessionBuilder::connect) makes the session.
    pub fn builder() -> SessionBuilder {
        SessionBuilder::default()
    }

    /// Memory for the boxes of a frame of `n` boxes: shared memory where a daemon serves, else
    /// the process's own. Its contents are unspecified: write every box.
    ///
    /// A daemon has three frames of a session at a time, in any mix of being filled, under way, and held as masks.
    /// With [`Backend::Auto`] further ones are answered in process, unless the engine that was named needs a GPU; with
    /// [`Backend::Daemon`] they are [`Error::TooManyFrames`].
    ///
    /// # Errors
    /// [`Error`]. With [`Backend::Auto`] a daemon that has exited or is full is no error: the frame
    /// is then answered in process.
    pub fn frame(&mut self, n: usize) -> Result<Frame, Error> {
        Frame::new(&self.core, n, Written::by(&Precision::Exact), ())
    }

    /// As [`frame`](Self::frame), for boxes that are written with less precision and fewer bytes.
    /// [`Precision`] states which pairs that may add; no pair is missed.
    ///
    /// ```
    /// use pairmask_core::{Aabb, Bounds, Precision};
    /// use pairmask::{Backend, Session};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let world = Bounds::new([-100.0; 3], [100.0; 3])?;
    /// let mut session = Session::builder().backend(Backend::InProcess).connect()?;
    /// let mut frame = session.narrow_frame(2, Precision::Q16(world))?;
    /// frame.set(0, &Aabb::from([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]));
    /// frame.set(1, &Aabb::from([1.0005, 0.0, 0.0, 2.0, 1.0, 1.0]));
    /// let mask = frame.submit()?.wait()?;
    /// assert_eq!(mask.count(), 1, "a gap of 0.5 mm within a cell of 3 mm");
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`frame`](Self::frame).
    pub fn narrow_frame(
        &mut self,
        n: usize,
        precision: Precision,
    ) -> Result<Frame<Quantized>, Error> {
        let encoding = (precision, Encoder::new(&precision));
        Frame::new(&self.core, n, Written::by(&precision), encoding)
    }

    /// As [`frame`](Self::frame), for bounding spheres, 16 bytes each, in place of boxes. The mask is
    /// that of the spheres, exact: [`sphere`](pairmask_core::sphere) says what overlaps.
    ///
    /// A GPU takes spheres too. A frame fails
    /// where `gpu-brute` is asked for by name and there are more than 32,768 of them, and on a software
    /// adapter where there are more than 16 or `gpu-grid` is asked for.
    ///
    /// ```
    /// use pairmask::{Backend, Session};
    /// use pairmask_core::Sphere;
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let mut session = Session::builder().backend(Backend::InProcess).connect()?;
    /// let mut frame = session.sphere_frame(3)?;
    /// for (i, slot) in frame.spheres_mut().iter_mut().enumerate() {
    ///     *slot = Sphere::new([2.0 * i as f32, 0.0, 0.0], 1.0);
    /// }
    /// let mask = frame.submit()?.wait()?;
    /// assert_eq!(mask.to_vec(), [[0, 1], [1, 2]], "touching counts");
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`frame`](Self::frame).
    pub fn sphere_frame(&mut self, n: usize) -> Result<Frame<Sphere>, Error> {
        Frame::new(&self.core, n, Written::SPHERES, ())
    }

    /// A persistent scene: boxes stay from answer to answer, edits go in, changes of pairs come out.
    /// A session may have any number of scenes.
    ///
    /// A daemon keeps the scene where the session has one; else the engines of this process do. Sessions
    /// in process use their instruction set and calibration. Threads are the session's unless `options`
    /// name some.
    ///
    /// ```
    /// use pairmask::{Aabb, Backend, Report, SceneOptions, Session};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let mut session = Session::builder().backend(Backend::InProcess).connect()?;
    /// let mut scene = session.scene(SceneOptions::default())?;
    /// let at = |x: f32| Aabb::new([x, 0.0, 0.0], [x + 1.0, 1.0, 1.0]);
    ///
    /// let reported = scene.edit().set(7, at(0.0)).set(9, at(0.5)).commit(Report::Changes)?;
    /// assert_eq!(reported.begun().to_vec(), [[7, 9]]);
    ///
    /// let reported = scene.edit().set(9, at(5.0)).commit(Report::Changes)?;
    /// assert!(reported.ended().map(|ended| ended.pair).eq([[7, 9]]));
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// Boxes may have [margins](SceneOptions::margin), and are sent only when they have left theirs:
    ///
    /// ```
    /// use pairmask::{Aabb, Backend, Margin, Report, SceneOptions, Session};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let mut session = Session::builder().backend(Backend::InProcess).connect()?;
    /// let half = Margin::new(0.5)?;
    /// let mut scene = session.scene(SceneOptions::default().with_margin(half))?;
    /// let at = |x: f32| Aabb::new([x, 0.0, 0.0], [x + 1.0, 1.0, 1.0]);
    ///
    /// let edit = scene.edit().set(7, at(0.0)).set(9, at(1.2));
    /// assert!(edit.commit(Report::Changes)?.begun().is_empty());
    ///
    /// // Within its margin: no request is made, and the pair is reported.
    /// let answer = scene.edit().set(9, at(0.8)).commit(Report::Changes)?;
    /// assert_eq!(answer.begun(), [[7, 9]]);
    /// drop(answer);
    /// let stats = scene.margin_stats().expect("it has margins");
    /// assert_eq!((stats.requests, stats.sent), (1, 2));
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// A [shared](SceneOptions::shared) scene is written by several processes, each its own boxes. The first member
    /// makes it in the daemon's instance, and it ends with the last one.
    ///
    /// A writer [leases](Scene::lease) ranges of indices, and commits edits of their boxes. A tick ends when all
    /// writers have committed, or at its deadline: then all edits are applied at once, and every member that has
    /// committed is answered. A writer that was late keeps its last boxes, and is
    /// [named](SceneAnswer::late). A member without leases only listens: its commits are empty, and nobody
    /// waits for it. Answers do not depend on who committed first. Only the writer with the lowest lease may give the
    /// table of filters. Every writer may give filter data of its own boxes, and list pairs of them.
    ///
    /// The changes are a [resync](SceneAnswer::is_resync) at first, after the member has leased indices, after a long
    /// time without a commit, and where the daemon was restarted.
    ///
    /// A member leaves when its [`Scene`] is dropped. Its boxes are removed then, or kept, as the scene's terms say
    /// ([`SceneOptions::at_end`]). Kept boxes belong to the member that leases their indices next, which may set them;
    /// giving the lease back removes them, and so does a member that has lost its membership and joins again, since it
    /// sends all boxes that it knows.
    ///
    /// There is no shared scene in process: without a daemon this is an error, with any backend.
    ///
    /// ```no_run
    /// use pairmask::{Aabb, Report, SceneOptions, Session};
    ///
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// let mut session = Session::builder().connect()?;
    /// let mut scene = session.scene(SceneOptions::default().with_shared("arena"))?;
    /// // Each process has its own range, so that indices do not depend on who came first.
    /// scene.lease(0..25_000)?;
    /// for step in 0..100 {
    ///     let x = step as f32;
    ///     let edit = scene.edit().set(7, Aabb::new([x, 0.0, 0.0], [x + 1.0, 1.0, 1.0]));
    ///     let reported = edit.commit(Report::Changes)?;
    ///     println!("tick {:?}: {} pairs began", reported.tick(), reported.begun().len());
    ///     for range in reported.late() {
    ///         println!("the writer of {range:?} was late");
    ///     }
    /// }
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// [`Error`], of shared scenes only.
    pub fn scene(&mut self, options: SceneOptions) -> Result<Scene, Error> {
        Scene::new(&self.core, options)
    }

    /// A scene that was [saved](Scene::save), by this version or another of the same major one. Its boxes have not been
    /// reported: they begin with the next changes. Where `options` give it margins, its boxes have the usual ones.
    ///
    /// # Errors
    /// [`Error::SceneFile`] where it cannot be read, and as [`SceneEdit::commit`].
    pub fn load_scene(
        &mut self,
        options: SceneOptions,
        mut from: impl std::io::Read,
    ) -> Result<Scene, Error> {
        let mut scene = self.scene(options)?;
        scene.load(&mut from)?;
        Ok(scene)
    }

    /// How long the session waits for the daemon.
    pub fn deadline(&self) -> Duration {
        self.core.settings().deadline
    }

    /// What would serve the next frame by the present state: the daemon or this process.
    pub fn served_by(&self) -> ServedBy {
        self.core.served_by()
    }

    /// Asks the daemon for its status.
    ///
    /// # Errors
    /// [`Error`], also where the session has no daemon.
    pub fn daemon_status(&mut self) -> Result<StatusBody, Error> {
        self.core.daemon_status()
    }
}
