//! Scenes that persist: `pm_scene`.
//!
//! ```text
//! draft    what an edit says, until it is answered
//! edited   a scene with its edit under way, or answered: the answer borrows the scene
//! edit     the functions that write an edit, send it and wait
//! answer   the functions that read an answer
//! shared   the functions of scenes that several processes write
//! ```
#![allow(unsafe_code)]

mod answer;
mod draft;
mod edit;
mod edited;
mod shared;

use bytemuck::{Pod, Zeroable};
use pairmask::{Margin, MarginedPairs, SceneOptions};

use self::draft::Draft;
use self::edited::State;
use crate::call::call;
use crate::code::pm_code;
use crate::failure::Failure;
use crate::handles::handle;
use crate::memory::{Growing, array, check_out, growing, write, write_growing};
use crate::query::{Found, pm_found};
use crate::session::pm_session;
use crate::spares::{Decoded, Spares};
use crate::values::{boxes as as_boxes, pm_box, pm_ended, pm_tag, tags as as_tags};

/// A scene that persists: boxes stay from answer to answer, edits go in, changes of pairs come out. It lives on
/// without its session.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct pm_scene {
    /// Zero for none.
    pub id: u64,
}

handle!(pm_scene is Box<Scene>);

/// What a `pm_scene` names.
pub struct Scene {
    state: State,
    lists: Lists,
}

/// What a scene's answer was decoded to.
struct Lists {
    begun: Decoded,
    pairs: Decoded,
    ended: Option<Vec<pm_ended>>,
}

impl Lists {
    fn new(spares: &Spares) -> Self {
        let list = || Decoded::new(spares.clone());
        Self { begun: list(), pairs: list(), ended: None }
    }
}

/// A scene, and the edit of it that is being written.
struct Edited {
    scene: pairmask::Scene,
    draft: Draft,
}

impl Scene {
    fn new(scene: pairmask::Scene, spares: &Spares) -> Self {
        let state = State::new(Edited { scene, draft: Draft::default() });
        Self { state, lists: Lists::new(spares) }
    }

    /// The scene, after whatever was answered: the answer ends.
    fn edited(&mut self) -> Result<&mut Edited, Failure> {
        if !self.state.is_idle() {
            self.lists = Lists::new(&self.lists.begun.spares().clone());
        }
        self.state.end()
    }
}

/// Settings of a scene. Zeros mean that the library chooses.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct pm_scene_options {
    /// `sizeof(pm_scene_options)`.
    pub struct_size: usize,
    /// Indices are below this. At most 2^29; 2^24 unless set.
    pub most_boxes: u32,
    /// Threads of this process that the scene may use.
    pub threads: u32,
    /// `PM_MARGINS_...`: with margins, a box is sent only when it has left its own.
    pub margins: pm_margins,
    /// The margin of boxes that are set without one.
    pub usual_margin: f32,
}

/// Whether a scene's boxes have margins, and which pairs it tells: one of `PM_MARGINS_...`.
pub type pm_margins = u32;
/// Boxes have no margins.
pub const PM_MARGINS_NONE: pm_margins = 0;
/// Answers are those of the boxes as they were set.
pub const PM_MARGINS_EXACT: pm_margins = 1;
/// Near pairs are among the answers.
pub const PM_MARGINS_NEAR: pm_margins = 2;

// SAFETY: it is `repr(C)` and begins with its size; numbers have no invalid bit patterns.
unsafe impl Growing for pm_scene_options {}

/// # Safety
/// `options` is null or valid for as many bytes as its first field says.
unsafe fn options_of(options: *const pm_scene_options) -> Result<SceneOptions, Failure> {
    let none = pm_scene_options {
        struct_size: size_of::<pm_scene_options>(),
        most_boxes: 0,
        threads: 0,
        margins: PM_MARGINS_NONE,
        usual_margin: 0.0,
    };
    // SAFETY: the caller's promise about pointers is passed on.
    let given = unsafe { growing(options, none) }?;
    let mut options = SceneOptions::default();
    if given.most_boxes > 0 {
        options = options.with_most_boxes(given.most_boxes);
    }
    if given.threads > 0 {
        options = options.with_threads(given.threads as usize);
    }
    let pairs = match given.margins {
        PM_MARGINS_NONE => return Ok(options),
        PM_MARGINS_EXACT => MarginedPairs::Exact,
        PM_MARGINS_NEAR => MarginedPairs::Near,
        _ => return Err(Failure::argument("no such margins")),
    };
    Ok(options.with_margins(pairs, Margin::new(given.usual_margin)?))
}

/// Makes a scene. `options` may be null. A daemon keeps the scene where the session has one; else this process
/// does.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_create(
    session: pm_session,
    options: *const pm_scene_options,
    scene: *mut pm_scene,
) -> pm_code {
    call(|| {
        check_out(scene)?;
        // SAFETY: the caller's promise about pointers is passed on.
        let options = unsafe { options_of(options) }?;
        let made = session.with(|s| {
            let scene = s.session.scene(options);
            Ok(Scene::new(scene, &s.spares))
        })?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write(scene, pm_scene::new(Box::new(made))?) }
    })
}

/// Drops a scene. A shared one is left.
#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_drop(scene: pm_scene) -> pm_code {
    scene.drop()
}

/// Forgets what was told: the next changes are a resync. The scene's answer ends.
#[unsafe(no_mangle)]
pub extern "C" fn pm_scene_resync(scene: pm_scene) -> pm_code {
    call(|| {
        scene.with(|scene| {
            scene.edited()?.scene.resync();
            Ok(())
        })
    })
}

/// The box of an index, also one that is switched off; `PM_ERR_ABSENT` where there is none. The scene's answer
/// stays; an edit under way is not waited for any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_get(scene: pm_scene, index: u32, b: *mut pm_box) -> pm_code {
    call(|| {
        let found = scene.with(|scene| scene.state.look(|scene| scene.get(index)))?;
        let absent = Failure::new(crate::code::PM_ERR_ABSENT, "the index has no box");
        let found = found.ok_or(absent)?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write(b, pm_box { min: found.min, max: found.max }) }
    })
}

/// Facts about a scene.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub struct pm_scene_info {
    /// `sizeof(pm_scene_info)`, set by the caller.
    pub struct_size: usize,
    /// Boxes, those that are switched off too; of a shared scene, this member's.
    pub boxes: u64,
    /// Bytes that this process keeps of the scene.
    pub allocated_bytes: u64,
    /// Bytes that the daemon keeps of it, by its last answer; 0 where it has none, and of a shared scene.
    pub daemon_bytes: u64,
    /// Of a scene with margins: edits that were applied.
    pub edits: u64,
    /// Of those: edits for which a request was made.
    pub requests: u64,
    /// Boxes that edits set.
    pub set: u64,
    /// Of those: boxes that were sent.
    pub sent: u64,
}

/// Facts about a scene. Set `info->struct_size` first. The scene's answer stays; an edit under way is not waited for
/// any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_get_info(scene: pm_scene, info: *mut pm_scene_info) -> pm_code {
    call(|| {
        check_out(info)?;
        let look = |scene: &pairmask::Scene| {
            let stats = scene.margin_stats().unwrap_or_default();
            pm_scene_info {
                struct_size: 0,
                boxes: scene.len() as u64,
                allocated_bytes: scene.allocated_bytes() as u64,
                daemon_bytes: scene.daemon_bytes(),
                edits: stats.edits,
                requests: stats.requests,
                set: stats.set,
                sent: stats.sent,
            }
        };
        let facts = scene.with(|scene| scene.state.look(look))?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write_growing(info, &facts) }
    })
}

/// Asks which boxes of a scene some other boxes overlap. `tags` are null, or one for all, or one for each: then only
/// what may meet such a tag is found. The scene's answer ends. A shared scene is asked as the last tick made it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_scene_query(
    scene: pm_scene,
    boxes: *const pm_box,
    n: usize,
    tags: *const pm_tag,
    tag_count: usize,
    found: *mut pm_found,
) -> pm_code {
    call(|| {
        check_out(found)?;
        // SAFETY: the caller's promise about pointers is passed on.
        let (boxes, tags) =
            unsafe { (as_boxes(array(boxes, n)?), as_tags(array(tags, tag_count)?)) };
        let made = scene.with(|scene| {
            let spares = scene.lists.begun.spares().clone();
            let query = scene.edited()?.scene.query(boxes);
            let answer = match tags {
                [] => query,
                [tag] => query.tag(*tag),
                tags => query.tags(tags),
            }
            .find()?;
            Ok(Found { answer, decoded: Decoded::new(spares) })
        })?;
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe { write(found, pm_found::new(made)?) }
    })
}
