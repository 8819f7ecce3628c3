//! A scene in the memory of each GPU that has it. Every edit is applied on each, so that they need no word from one
//! another; a search is shared out.

use std::sync::Arc;

use pairmask_core::Aabb;
use pairmask_core::engine::CullError;
use pairmask_shaders::layouts::SceneSummary;

use super::cast::DeviceTree;
use super::memory::{Blocks, Memory};
use super::plan::Room;
use super::search::{Asked, Frames, Search, TIMEOUT, Task};
use super::upload::{GatheredSets, Upload, Uploaded};
use super::{ENGINE, wide};
use crate::execute::gpu::{GpuError, Part, QueueRole, SceneTools};

pub(super) struct Replica {
    pub tools: Arc<SceneTools>,
    pub upload: Upload,
    pub memory: Memory,
    pub frames: Frames,
    edit: Option<Uploaded>,
    pub blocks: Option<Blocks>,
    /// For casts, once there were many.
    pub casts: Option<DeviceTree>,
}

pub(super) struct QueriesUploaded {
    pub queries: Option<Part>,
    /// Whether blocks are others, so that nothing stands in them.
    pub replaced: bool,
}

/// What becomes of the names that edits have given boxes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Names {
    /// They stay: the edit gives none.
    Kept,
    /// They stay, and the edit gives some with a new number.
    Given,
    /// They are dropped: numbers begin anew.
    Discarded,
}

impl Replica {
    fn new(tools: &Arc<SceneTools>) -> Self {
        Self {
            upload: Upload::default(),
            memory: Memory::new(tools),
            tools: Arc::clone(tools),
            frames: Frames::new(QueueRole::Frames),
            edit: None,
            blocks: None,
            casts: None,
        }
    }

    /// Bytes that are allocated, in video memory for the most part.
    pub fn bytes(&self) -> u64 {
        self.memory.bytes() + self.casts.as_ref().map_or(0, DeviceTree::bytes)
    }

    /// Makes room for records of `slots` indices, and brings an edit, and queries that are no entries of it.
    pub fn put(
        &mut self,
        sets: GatheredSets<'_>,
        marks: &[[u32; 2]],
        queries: &[Aabb],
        slots: u64,
        names: Names,
        threads: usize,
    ) -> Result<QueriesUploaded, GpuError> {
        let mut replaced = false;
        self.blocks = None;
        self.memory.make_records(&self.tools, slots, &mut replaced)?;
        // Records that were made anew have no names, and those that there were matter to no later edit.
        if names == Names::Discarded || names == Names::Given && self.memory.named.is_none() {
            self.memory.discard_named(&self.tools, &mut replaced)?;
        }
        let gpu = &self.tools.gpu;
        let queries = (!queries.is_empty())
            .then(|| self.upload.queries.copied(gpu, queries, threads, &mut replaced))
            .transpose()?;
        self.edit = Some(self.upload.put(gpu, sets, marks, threads, &mut replaced)?);
        if replaced {
            self.frames.clear();
            if let Some(tree) = &mut self.casts {
                tree.forget_frames();
            }
        }
        Ok(QueriesUploaded { queries, replaced })
    }

    /// Has the GPU begin. Returns what there is room for. [`Self::wait`] comes next.
    pub fn submit(&mut self, asked: &Asked<'_>) -> Result<Room, GpuError> {
        let Self { tools, memory, frames, edit, blocks, .. } = self;
        let edit = edit.as_ref().ok_or(GpuError::Lost)?;
        *blocks = None;
        let (mut asked, mut replaced) = (*asked, false);
        let made = memory.blocks(tools, &asked.sizes, asked.room, &mut replaced)?;
        if replaced {
            frames.clear();
            // What stood no longer exists.
            if let Search::Grid { builds, .. } = &mut asked.search {
                *builds = true;
            }
        }
        let task = Task { asked, edit, blocks: &made };
        task.submit(tools, frames)?;
        let room = task.room_made();
        *blocks = Some(made);
        Ok(room)
    }

    pub fn wait(&mut self, asked: &Asked<'_>) -> Result<SceneSummary, GpuError> {
        let Self { tools, frames, .. } = self;
        let timeout = TIMEOUT[usize::from(tools.gpu.is_software())];
        frames.last_mut().map_or(Ok(()), |frame| frame.end(timeout))?;
        let mut summary = [SceneSummary::default()];
        if !matches!(asked.search, Search::Nothing) {
            self.blocks.as_ref().ok_or(GpuError::Lost)?.summary.block.read(0, &mut summary);
        }
        Ok(summary[0])
    }
}

/// The replicas of a scene: one at the least. The first answers queries.
pub(super) struct Replicas(pub Vec<Replica>);

impl Replicas {
    /// One for each, at least one.
    pub fn new(tools: &[Arc<SceneTools>]) -> Self {
        assert!(!tools.is_empty(), "a scene in video memory is on some device");
        Self(tools.iter().map(Replica::new).collect())
    }

    /// One more for each whose device has none.
    pub fn add(&mut self, tools: &[Arc<SceneTools>]) {
        for tools in tools {
            if !self.0.iter().any(|replica| Arc::ptr_eq(replica.tools.gpu(), tools.gpu())) {
                self.0.push(Replica::new(tools));
            }
        }
    }

    pub fn first(&mut self) -> &mut Replica {
        &mut self.0[0]
    }

    /// Gives up the one that answers queries, where there is another. Whether there was.
    pub fn leave_first(&mut self) -> bool {
        let has_others = self.0.len() > 1;
        if has_others {
            self.0.remove(0);
        }
        has_others
    }

    /// Does something with each, in order, and returns what came of it. A GPU that fails has the scene no more,
    /// unless all do: what is on one of them is on each.
    pub fn on_each<R>(
        &mut self,
        mut work: impl FnMut(usize, &mut Replica) -> Result<R, GpuError>,
    ) -> Result<Vec<R>, CullError> {
        let all = self.0.iter_mut().enumerate();
        let results: Vec<_> = all.map(|(at, replica)| work(at, replica)).collect();
        let has_failed = !results.iter().any(Result::is_ok);
        let (mut done, mut first_error) = (Vec::with_capacity(results.len()), None);
        let mut results = results.into_iter();
        self.0.retain(|replica| match results.next() {
            Some(Ok(result)) => {
                done.push(result);
                true
            }
            Some(Err(error)) => {
                let error = replica.tools.gpu.cull_error(ENGINE, &error);
                if !has_failed {
                    log::warn!("a scene goes on without one of its GPUs: {error}");
                }
                first_error.get_or_insert(error);
                has_failed
            }
            None => true,
        });
        match first_error {
            Some(error) if has_failed => Err(error),
            _ => Ok(done),
        }
    }

    pub fn end_edit(&mut self) {
        for replica in &mut self.0 {
            replica.edit = None;
        }
    }
}

/// What the shares of a search found together. All of them have the same entries, unless a client writes to the
/// boxes of its edit while each GPU reads them: then there must be room for the most.
pub(super) fn sum(shares: &[SceneSummary]) -> SceneSummary {
    let words = |of: fn(&SceneSummary) -> [u32; 2]| {
        let all: u64 = shares.iter().map(|share| wide(of(share))).sum();
        [all as u32, (all >> 32) as u32]
    };
    let first = shares.first().copied().unwrap_or_default();
    SceneSummary {
        entries: shares.iter().map(|share| share.entries).max().unwrap_or(0),
        found: words(|share| share.found),
        ended: words(|share| share.ended),
        tested: words(|share| share.tested),
        ..first
    }
}
