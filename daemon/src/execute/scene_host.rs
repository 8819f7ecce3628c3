//! A scene where it is kept: by the cores of this machine, or in video memory.
//!
//! It begins with the cores. It moves to the GPU, unless an engine was asked for by name, when what its
//! edits, queries and casts would have saved there comes to more than the move takes: so it never pays more than twice
//! what the better place costs. It stays there: an edit takes the GPU 50 µs at the least, and boxes would have to
//! come back. A large scene is kept by all GPUs, if it is large when it moves, or with its first boxes.

use std::sync::Arc;
use std::time::Instant;

use pairmask_core::cancel::Wanted;
use pairmask_core::cast::Hit;
use pairmask_core::dispatch::{CpuEngines, nanoseconds_since};
use pairmask_core::engine::CullError;
use pairmask_core::plan::GpuCost;
use pairmask_core::scene::{
    Cast, Edit, FilterHistory, QueryError, QueryFilterData, Report, Reported, Scene, SceneError,
    SceneOptions,
};
use pairmask_core::{Aabb, EngineChoice, EngineName};

use super::gpu::{GpuScene, is_for_gpu};
use super::gpus::SceneGpus;

/// What a box costs an edit in video memory that does not change it, in those of a frame's grid: it is
/// looked at once (an H200: 0.08 ns).
const UNCHANGED_SHARE: f64 = 0.125;
/// What a changed box or a query costs, in boxes of a frame's grid: it is written, and searched for (an H200: 3 to
/// 7 ns).
const CHANGED_SHARE: f64 = 8.0;
/// A ray or a sphere costs as much as so many queries (an H200: 8 to 20 ns to look for one, and 10 to 50 to decide it).
const CAST_QUERIES: usize = 8;
/// What a ray or a sphere takes the cores at most, ns. More than that was the building of a tree, which the GPU needs as
/// well.
const MOST_CAST_NS: f64 = 2_000.0;
/// Time to move a scene, ns a box: collected here, copied, and written there.
const MOVE_NS_A_BOX: f64 = 100.0;
/// Time to move any scene, ns: memory is taken.
const MOVE_NS: f64 = 1e6;

pub struct SceneHost {
    side: Side,
    options: SceneOptions,
    gpus: SceneGpus,
    engine: EngineChoice,
    threads: usize,
    most_query_pairs: u64,
    /// Most GPUs that there is room on for it. Who makes room for an edit sets it, and has the scene to read alone.
    most_gpus: usize,
    /// What edits, queries and casts would have saved on the GPU, ns.
    would_have_saved_ns: f64,
}

#[allow(clippy::large_enum_variant)] // One of each scene.
enum Side {
    Cores(Scene),
    Gpu(GpuScene),
}

macro_rules! on_side {
    ($side:expr, $scene:ident => $what:expr) => {
        match $side {
            Side::Cores($scene) => $what,
            Side::Gpu($scene) => $what,
        }
    };
}

/// What an edit or a query is expected to take in video memory, ns.
fn gpu_ns(cost: &GpuCost, boxes: usize, searched: usize) -> Option<f64> {
    let grid_boxes = UNCHANGED_SHARE * boxes as f64 + CHANGED_SHARE * searched as f64;
    Some(cost.fixed_ns + cost.grid_fixed_ns + cost.grid_ns_a_box? * grid_boxes)
}

impl SceneHost {
    pub fn new(
        options: SceneOptions,
        engines: CpuEngines,
        mut gpus: SceneGpus,
        engine: EngineChoice,
    ) -> Result<Self, CullError> {
        let side = match engine {
            EngineChoice::Only(engine) if engine.is_gpu() => {
                let unavailable = CullError::Unavailable { engine, why: "there is no GPU" };
                gpus.check_opened(engine)?;
                let home = gpus.home().ok_or(unavailable)?;
                Side::Gpu(GpuScene::new(&home, options.with_threads(1)))
            }
            _ => Side::Cores(Scene::with_engines(options, engines)),
        };
        Ok(Self {
            side,
            options,
            gpus,
            engine,
            threads: 1,
            most_query_pairs: u64::from(u32::MAX),
            most_gpus: usize::MAX,
            would_have_saved_ns: 0.0,
        })
    }

    /// Boxes, those that are disabled too.
    pub const fn len(&self) -> usize {
        on_side!(&self.side, scene => scene.len())
    }

    pub const fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Indices with a box are below this.
    pub fn index_end(&self) -> u32 {
        on_side!(&self.side, scene => scene.index_end())
    }

    pub const fn engine(&self) -> EngineName {
        match &self.side {
            Side::Cores(_) => EngineName::CpuGrid,
            Side::Gpu(_) => EngineName::GpuGrid,
        }
    }

    /// GPUs that have it: none where the cores do.
    pub const fn gpu_count(&self) -> usize {
        match &self.side {
            Side::Cores(_) => 0,
            Side::Gpu(scene) => scene.gpu_count(),
        }
    }

    /// Most GPUs that may have it after an edit of so many boxes, if there is room on them; one at the least.
    pub fn most_copies(&self, boxes: usize) -> usize {
        match &self.side {
            Side::Cores(_) => self.gpus.most_for(self.len().max(boxes)),
            Side::Gpu(scene) if scene.is_new() => self.gpus.most_for(boxes).max(scene.gpu_count()),
            Side::Gpu(scene) => scene.gpu_count(),
        }
    }

    /// Has at most so many GPUs keep it from the next edit on.
    pub fn limit_gpus(&mut self, most: usize) {
        self.most_gpus = most.max(1);
    }

    pub fn bytes(&self) -> u64 {
        match &self.side {
            Side::Cores(scene) => scene.allocated_bytes() as u64,
            Side::Gpu(scene) => scene.allocated_bytes() as u64 + scene.video_bytes(),
        }
    }

    pub fn set_threads(&mut self, threads: usize) {
        self.threads = threads;
        on_side!(&mut self.side, scene => scene.set_threads(Some(threads)));
    }

    /// Most pairs that later edits may find where they look for all. In video memory a list is as long as the device
    /// can make one.
    pub fn limit_pairs(&mut self, most: u64) {
        if let Side::Cores(scene) = &mut self.side {
            scene.limit_pairs(most);
        }
    }

    pub fn limit_query_pairs(&mut self, most: u64) {
        self.most_query_pairs = most;
        on_side!(&mut self.side, scene => scene.limit_query_pairs(most));
    }

    /// As [`Scene::set_asker`].
    pub fn set_asker(&mut self, asker: Option<Arc<dyn Wanted>>) {
        on_side!(&mut self.side, scene => scene.set_asker(asker));
    }

    /// Notes an edit, a query or a cast that the cores have answered: of so many boxes that a GPU would have looked at, and
    /// so many that it would have searched around.
    fn note_cores(&mut self, boxes: usize, searched: usize, took_ns: f64) {
        if self.engine != EngineChoice::Auto {
            return;
        }
        let there = self.gpus.cost().and_then(|cost| gpu_ns(&cost, boxes, searched));
        if let Some(there_ns) = there {
            let saved = self.would_have_saved_ns + took_ns - there_ns;
            self.would_have_saved_ns = saved.max(0.0);
        }
    }

    /// Moves the scene to the GPU where that is due, and the last answer was taken.
    fn move_if_due(&mut self) {
        let move_ns = MOVE_NS + MOVE_NS_A_BOX * self.len() as f64;
        if self.would_have_saved_ns <= move_ns {
            return;
        }
        let Side::Cores(scene) = &self.side else { return };
        let Some(snapshot) = scene.snapshot() else { return };
        self.would_have_saved_ns = 0.0;
        let Some(home) = self.gpus.home() else { return };
        let mut tools = vec![home];
        tools.extend(self.gpus.others(scene.len()));
        tools.truncate(self.most_gpus);
        let _turns =
            self.gpus.turns(|gpu| tools.iter().any(|t| std::ptr::eq(Arc::as_ptr(t.gpu()), gpu)));
        match GpuScene::from_snapshot(&tools, self.options.with_threads(self.threads), &snapshot) {
            Ok(mut moved) => {
                moved.limit_query_pairs(self.most_query_pairs);
                self.side = Side::Gpu(moved);
            }
            // The cores have it, and are asked again when as much time was lost.
            Err(error) => log::info!("a scene stays with the cores: {error}"),
        }
    }

    pub const fn filters(&self) -> &FilterHistory {
        on_side!(&self.side, scene => scene.filters())
    }

    /// As [`Scene::edit`]. After [`SceneError::Cull`] the scene is to be dropped.
    pub fn edit(&mut self, edit: Edit<'_>, report: Report) -> Result<(), SceneError> {
        self.move_if_due();
        let most_gpus = self.most_gpus;
        match &mut self.side {
            Side::Cores(scene) => {
                let start = Instant::now();
                scene.edit(edit, report)?;
                let took_ns = nanoseconds_since(start) as f64;
                self.note_cores(self.len(), edit.boxes(), took_ns);
            }
            Side::Gpu(scene) => {
                if scene.is_new() {
                    scene.share(&self.gpus.others(edit.boxes()));
                }
                scene.keep_on(most_gpus);
                // One session uses a GPU at a time.
                let _turns = self.gpus.turns(|gpu| scene.is_on(gpu));
                scene.edit(edit, report)?;
            }
        }
        Ok(())
    }

    pub const fn reported(&self) -> &Reported {
        on_side!(&self.side, scene => scene.reported())
    }

    pub fn acknowledge(&mut self) {
        on_side!(&mut self.side, scene => scene.acknowledge());
    }

    pub fn mark_reported(&mut self, pair_count: u64) {
        on_side!(&mut self.side, scene => scene.mark_reported(pair_count));
    }

    pub fn resync(&mut self) {
        on_side!(&mut self.side, scene => scene.resync());
    }

    pub fn query(
        &mut self,
        queries: &[Aabb],
        filter_data: QueryFilterData<'_>,
        found: &mut Vec<[u32; 2]>,
    ) -> Result<u64, QueryError> {
        self.move_if_due();
        match &mut self.side {
            Side::Cores(scene) => {
                let start = Instant::now();
                let tested = scene.query(queries, filter_data, found)?;
                let took_ns = nanoseconds_since(start) as f64;
                self.note_cores(self.len(), queries.len(), took_ns);
                Ok(tested)
            }
            Side::Gpu(scene) => {
                // One session uses a GPU at a time.
                let _turns = self.gpus.turns(|gpu| scene.is_on(gpu));
                scene.query(queries, filter_data, found)
            }
        }
    }
}

impl SceneHost {
    /// As [`Scene::cast`]. Returns who answered: where the scene is in video memory, its engine, or the cores from a copy.
    pub fn cast(
        &mut self,
        cast: &Cast<'_>,
        found: &mut Vec<Hit>,
    ) -> Result<EngineName, QueryError> {
        self.move_if_due();
        match &mut self.side {
            Side::Cores(scene) => {
                let start = Instant::now();
                scene.cast(cast, found)?;
                let (shapes, took_ns) = (cast.shapes.len(), nanoseconds_since(start) as f64);
                if is_for_gpu(cast) {
                    let took_ns = took_ns.min(MOST_CAST_NS * shapes as f64);
                    self.note_cores(0, CAST_QUERIES * shapes, took_ns);
                }
                Ok(EngineName::CpuTree)
            }
            Side::Gpu(scene) => {
                let _turns = self.gpus.turns(|gpu| scene.is_on(gpu));
                scene.cast(cast, found)?;
                let is_gpu = scene.left_to_cores() < cast.shapes.len();
                Ok(if is_gpu { EngineName::GpuGrid } else { EngineName::CpuTree })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edit_on_the_gpu_costs_by_what_changes() {
        let cost = GpuCost {
            fixed_ns: 40_000.0,
            ns_a_box: 0.0,
            ns_a_test: 0.0,
            grid_fixed_ns: 10_000.0,
            grid_ns_a_box: Some(0.8),
            ns_a_reply_byte: 0.0,
            ns_a_read_byte: 0.0,
        };
        let ns = |boxes, changed| gpu_ns(&cost, boxes, changed).expect("a grid");
        assert!((ns(0, 0) - 50_000.0).abs() < 1.0);
        assert!((ns(1_000_000, 0) - 150_000.0).abs() < 1.0);
        assert!((ns(1_000_000, 10_000) - 214_000.0).abs() < 1.0);
        assert_eq!(gpu_ns(&GpuCost { grid_ns_a_box: None, ..cost }, 9, 9), None);
    }

    #[test]
    fn a_scene_without_a_gpu_stays_with_the_cores() {
        let no_gpu = SceneGpus::none();
        let options = SceneOptions::default();
        let only = EngineChoice::Only(EngineName::GpuGrid);
        let refused = SceneHost::new(options, CpuEngines::new(), no_gpu.clone(), only);
        assert!(matches!(refused, Err(CullError::Unavailable { .. })));
        let auto = SceneHost::new(options, CpuEngines::new(), no_gpu, EngineChoice::Auto);
        let mut scene = auto.expect("cores");
        scene.would_have_saved_ns = 1e12;
        scene.edit(Edit::NONE, Report::All).expect("an answer");
        assert_eq!(scene.engine(), EngineName::CpuGrid);
    }
}
