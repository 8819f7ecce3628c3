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
//! let mask = frame.submit()?.wait()?; // or try_take(), wait_timeout(d)
//! for (a, b) in mask.pairs() {
//!     println!("boxes {a} and {b} overlap");
//! }
//! assert!(mask.contains(0, 1) && mask.contains(1, 2) && mask.count() == 2);
//! # Ok(())
//! # }
//! ```
//!
//! Boxes are closed: touching counts. Daemon and in-process engines find the same pairs, none lost
//! and none added; [`aabb`] says what overlaps.
//!
//! # The way of a frame
//!
//! | step | what | where |
//! |---|---|---|
//! | connect | [`Session`], made by a [`SessionBuilder`](session::SessionBuilder) | [`session`] |
//! | fill | [`Frame::boxes_mut`]: a plain slice of [`Aabb`], in the order of your objects; [`update`] writes it from local boxes and transforms | [`aabb`], [`update`] |
//! | submit, wait | [`PendingFrame`]: the frame is under way while you do something else | [`session`] |
//! | decode | [`PairMask`]: [`pairs`](PairMask::pairs), [`par_pairs`](PairMask::par_pairs), [`contains`](PairMask::contains); [`words`](PairMask::words) for AND masks of your own | [`mask`] |
//!
//! Below the sessions are the engines ([`engine`], [`sphere`]), their choice ([`plan`]), the numbering
//! of pairs ([`pair_index`]), the naive answer that every engine is tested against ([`oracle`]), and
//! the bytes in shared memory ([`wire`]). Engines can be used without a session.
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
//! | [`Margined`](session::Margined) | as above | scenes that move little: a request only when a box has moved by more than a margin |
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
//! | `calibration-file` | yes | in-process plans compute with what `pairmaskd calibrate` measured on this machine |
//! | `glam` | no | glam's transforms for [`update`], and pairs of its vectors from boxes. Any version from 0.29 to 0.34: Cargo takes the newest unless told otherwise (`cargo update -p glam@NEWEST --precise YOURS`) |
//! | `mint` | no | the same for mint 0.5 |
//!
//! Without `daemon`, sessions answer in process, [`Backend::Auto`] is [`Backend::InProcess`], and
//! [`Backend::Daemon`] is a typed error.
//!
//! # Platforms
//!
//! With `daemon`: Linux, 64 bits, little-endian. Without it: wherever the standard library has
//! threads and a clock. The engines use AVX2, AVX-512 or NEON where the processor has them.

pub mod session;
#[cfg(not(feature = "daemon"))]
#[path = "absent_transport.rs"]
mod transport;

pub use pairmask_core::{
    aabb, awake_pool, dispatch, engine, floats, mask, oracle, pair_index, plan, precision, sphere,
    units, update,
};
/// The transport, and the parts of the wire contract that are named under it.
#[cfg(feature = "daemon")]
pub mod transport {
    pub use pairmask_core::spinner::Spinner;
    pub use pairmask_transport::*;
    pub use pairmask_wire::{
        InstanceError, InstanceName, boxes_in, boxes_in_mut, bytes_in_mut, narrow_boxes_in,
        objects_in, spheres_in, spheres_in_mut, words_in, words_in_mut,
    };
}
/// The wire contract, and the parts of the core that are named under it.
pub mod wire {
    pub use pairmask_core::dispatch::StageTimes;
    pub use pairmask_core::objects::{ObjectForm, Objects};
    pub use pairmask_wire::*;
}

pub use aabb::{Aabb, BoxClass};
pub use awake_pool::AwakePool;
pub use engine::{EngineChoice, EngineName};
pub use mask::{Encoding, EncodingChoice, MaskView};
pub use pairmask_core::objects::ObjectForm;
pub use precision::{Bounds, BoxForm, Precision};
pub use session::{Backend, Frame, PairMask, PendingFrame, ServedBy, Session};
pub use sphere::Sphere;
pub use units::{BoxCount, MaskWord, PairIndex};
