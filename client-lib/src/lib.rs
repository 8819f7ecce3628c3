//! Pairmask: which of many boxes overlap. Broad-phase collision culling, exact and fast, in process or
//! by a daemon through shared memory.
//!
//! ```
//! use pairmask::{Aabb, Backend, Session};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let mut session = Session::builder().backend(Backend::Auto).connect()?;
//!
//! let mut frame = session.frame(3)?; // shared memory where a daemon serves
//! for (i, slot) in frame.boxes_mut().iter_mut().enumerate() {
//!     let x = 0.8 * i as f32;
//!     *slot = Aabb::new([x, 0.0, 0.0], [x + 1.0, 1.0, 1.0]);
//! }
//!
//! let mask = frame.submit()?.wait()?; // or try_receive(), wait_timeout(d)
//! for [a, b] in mask.pairs() {
//!     println!("boxes {a} and {b} overlap");
//! }
//! assert!(mask.contains(0, 1) && mask.contains(1, 2) && mask.count() == 2);
//! # Ok(())
//! # }
//! ```
//!
//! Boxes are closed: touching counts. A box with `min > max` on some axis is empty, one with a NaN is
//! invalid, and neither overlaps anything; infinities are coordinates. Daemon and in-process engines
//! find the same pairs, none lost and none added.
//!
//! # The way of a frame
//!
//! | step | what |
//! |---|---|
//! | connect | [`Session`], made by a [`SessionBuilder`] |
//! | fill | [`Frame::write`]: a slice of [`Aabb`], arrays of corners or of centres and half extents ([`MinMax`], [`CenterHalf`]), or local boxes and transforms ([`Transformed`]); or write in place, [`Frame::boxes_mut`] |
//! | submit, wait | [`Pending`]: the frame is under way while you do something else |
//! | decode | [`PairMask`]: [`pairs`](PairMask::pairs), [`par_pairs`](PairMask::par_pairs), [`contains`](PairMask::contains); [`words`](PairMask::words) for AND masks of your own |
//!
//! Engines, the plan and the wire contract are in the crates `pairmask-core`, `pairmask-wire` and
//! `pairmask-transport`. Engines can be used without a session.
//!
//! # Which session
//!
//! Who answers ([`Backend`]; the pairs are the same):
//!
//! * [`Backend::Auto`], unless you say otherwise: the daemon where one serves, else this process.
//!   The session returns to the daemon by itself; a daemon that dies costs no frame.
//! * [`Backend::InProcess`]: the CPU engines of this library. For tests, tools, and platforms without
//!   a daemon.
//! * [`Backend::Daemon`]: the daemon or a typed error. For measurements, and where the engine's
//!   threads or the GPU must not be this process's.
//!
//! What is sent:
//!
//! | | bytes an object | for |
//! |---|---|---|
//! | [`Session::frame`] | 24 | boxes in f32, exact |
//! | [`Session::narrow_frame`] | 12 or 6 | boxes with less [`Precision`]: fewer bytes, some extra pairs, none missed |
//! | [`Session::sphere_frame`] | 16 | bounding spheres in place of boxes, exact |
//! | [`Session::scene`] | what changes | persistent scenes: edits in, pairs that began and ended out; few boxes move, or changes are what you need |
//! | the same with [margins](SceneOptions::margin) | what leaves its margin | where many boxes move a little |
//! | the same, [shared](SceneOptions::shared) | what changes | one scene that several processes write, each its own boxes |
//!
//! Frames of boxes may have collision filters ([`filters`], [`FrameOptions`]): worlds side by side, owners,
//! categories and masks, groups, and lists of pairs.
//!
//! Worlds in f64 go through [`Aabb::outward_from_f64`], relative to an origin.
//!
//! # Vectors and matrices
//!
//! The interface has plain arrays, and takes every type that converts into one: `[f32; 3]`, and the
//! vectors of glam (any version), nalgebra and mint. Matrices are arrays by columns, which
//! `to_cols_array_2d()` of glam gives.
//!
//! # Features
//!
//! | feature | default | what it adds |
//! |---|---|---|
//! | `daemon` | yes | the transport: sessions with a daemon. Linux only |
//! | `glam` | no | glam's transforms for [`Transformed`], and pairs of its vectors from boxes. Any version from 0.29 to 0.34: Cargo takes the newest unless set otherwise (`cargo update -p glam@NEWEST --precise YOURS`) |
//! | `mint` | no | the same for mint 0.5 |
//!
//! Without `daemon`, sessions answer in process, [`Backend::Auto`] is [`Backend::InProcess`], and
//! [`Backend::Daemon`] is a typed error.
//!
//! # Platforms
//!
//! With `daemon`: Linux, 64 bits, little-endian. Without it: wherever the standard library has
//! threads and a clock. The engines use AVX2 or AVX-512 where the processor has them.

#[cfg(doctest)]
mod book;
mod session;
#[cfg(feature = "daemon")]
use pairmask_transport as transport;
#[cfg(not(feature = "daemon"))]
use session::link as transport;

/// What rays and spheres hit, and in which order: the definition, and what is asked and answered.
///
/// # What is hit
///
/// In the arithmetic of real numbers, without rounding: a [`Ray`](cast::Ray) hits a box if a point
/// `origin + t · direction` with 0 ≤ t ≤ `most` lies in the box, faces included, after they were moved outward by its
/// `half_extents`; its distance is the least such t. A [`Sphere`] touches a box if a point of the box is at most its radius
/// away from its center; its distance is that of the nearest one. Hits come by distance and then by index.
/// [`pairmask_core::cast`] says what holds at infinity and of invalid rays.
pub mod cast {
    pub use pairmask_core::cast::{Hit, Hits, Ray, Shapes};
}

/// Which boxes meet: filter data, filters and listed pairs. [`pairmask_core::filters`] has the rule, and its types have
/// examples.
pub mod filters {
    pub use pairmask_core::filters::{
        Filter, FilterData, FilterId, FilterTable, Owner, PairLists, Rules, World,
    };
    pub use pairmask_core::scene::QueryFilterData;

    /// Filters of other engines. [`pairmask_core::filters::engines`] says what the functions take into account, and has
    /// two more, for the bodies of a `MuJoCo` model and the collision groups of Jolt's bodies.
    pub mod engines {
        pub use pairmask_core::filters::engines::{
            from_avian, from_box2d, from_bullet, from_jolt_layers, from_jolt_mask, from_mujoco,
            from_newton, from_physx_group, from_physx_groups_mask, from_physx_words, from_rapier,
            from_relation, owner_of,
        };
    }
}

pub use pairmask_core::aabb::Aabb;
pub use pairmask_core::mask::PairList;
pub use pairmask_core::precision::{Bounds, Margin, Precision};
pub use pairmask_core::scene::shared::{AtEnd, Scope};
pub use pairmask_core::scene::{EditError, EndReason, Ended, MarginStats, Report, SnapshotId};
pub use pairmask_core::sphere::Sphere;
pub use pairmask_core::update::{Placement, Transformed};
pub use pairmask_core::write::{BoxSource, CenterHalf, MinMax};
pub use pairmask_wire::{Observed, SceneFileError, StatusBody as DaemonStatus};
pub use session::{
    Backend, ConnectError, Error, Frame, FrameInfo, FrameObject, FrameOptions, HitAnswer, PairMask,
    Pending, Quantized, QueryAnswer, Scene, SceneAnswer, SceneEdit, SceneOptions, ServedBy,
    Session, SessionBuilder,
};
