//! The fields of records and of this run that the papers' claims need. The reports of this run are
//! read through their JSON, so that both have one way.

use serde::Deserialize;

/// Machine of a record.
#[derive(Clone, Debug, Default, Deserialize)]
pub struct RecordMachine {
    pub cpu: String,
    /// Threads that ran; `threads.json` calls them cores.
    #[serde(alias = "cores")]
    pub threads: usize,
    #[serde(default)]
    pub gpu: Option<String>,
    #[serde(default)]
    pub gpu_is_software: bool,
    #[serde(default)]
    pub commit: String,
    #[serde(default)]
    pub command: String,
}

/// `mapping.json`.
#[derive(Clone, Debug, Deserialize)]
pub struct Mapping {
    pub machine: RecordMachine,
    pub root_errors: Vec<RootErrors>,
    pub pair_errors: Vec<PairErrors>,
    pub map_times: Vec<MapTime>,
    pub root_times: Vec<RootTime>,
    pub outputs: Vec<Output>,
    pub growth: Vec<Growth>,
}

#[derive(Clone, Debug, Deserialize)]
pub struct RootErrors {
    pub processor: String,
    pub root: String,
    pub tally: RootTally,
}

#[derive(Clone, Debug, Deserialize)]
pub struct RootTally {
    pub count: u64,
    pub other: u64,
}

#[derive(Clone, Debug, Deserialize)]
pub struct PairErrors {
    pub processor: String,
    pub variant: String,
    pub n: u32,
    pub tally: PairTally,
}

#[derive(Clone, Debug, Deserialize)]
pub struct PairTally {
    pub wrong: u64,
}

#[derive(Clone, Debug, Deserialize)]
pub struct MapTime {
    pub processor: String,
    pub variant: String,
    pub n: u32,
    pub ms: Option<f64>,
}

#[derive(Clone, Debug, Deserialize)]
pub struct RootTime {
    pub processor: String,
    pub root: String,
    pub count: u64,
    pub ms: Option<f64>,
}

#[derive(Clone, Debug, Deserialize)]
pub struct Output {
    pub n: u32,
    pub bits_per_pair: u32,
    pub thread_a_pair: bool,
    pub kernel_ms: f64,
    pub transfer_us: f64,
}

#[derive(Clone, Debug, Deserialize)]
pub struct Growth {
    pub n: u32,
    pub kernel_ms: f64,
    pub upload_us: f64,
    pub transfer_us: f64,
    pub input_bytes: u64,
    pub output_bytes: u64,
}

/// `grid.json`.
#[derive(Clone, Debug, Deserialize)]
pub struct Grid {
    pub machine: RecordMachine,
    pub parts: Vec<Parts>,
    pub with_and_without: Vec<WithAndWithout>,
    pub engines: Vec<Engines>,
    pub moving: Vec<MovingShare>,
}

#[derive(Clone, Debug, Deserialize)]
pub struct Parts {
    pub n: u32,
    pub update_boxes_ms: f64,
    pub update_grid_ms: f64,
    pub cull_ms: f64,
    pub total_ms: f64,
}

#[derive(Clone, Debug, Deserialize)]
pub struct WithAndWithout {
    pub n: u32,
    pub without_ms: f64,
    pub with_ms: f64,
}

#[derive(Clone, Debug, Deserialize)]
pub struct Engines {
    pub n: u32,
    pub gpu_grid_ms: f64,
    pub cpu_sap_ms: Option<f64>,
}

#[derive(Clone, Debug, Deserialize)]
pub struct MovingShare {
    pub n: u32,
    pub moving_percent: u32,
    pub frame_ms: f64,
}

/// `threads.json`.
#[derive(Clone, Debug, Deserialize)]
pub struct Threads {
    pub machine: RecordMachine,
    pub rows: Vec<ThreadRow>,
}

#[derive(Clone, Debug, Deserialize)]
pub struct ThreadRow {
    pub stage: String,
    pub scene: String,
    pub n: usize,
    pub engine: Option<String>,
    pub threads: usize,
    pub least_ns: u64,
}

/// `spheres.json`, `spheres-errors.json` and `spheres.txt`.
#[derive(Clone, Debug, Default, Deserialize)]
pub struct Spheres {
    #[serde(default)]
    pub machine: RecordMachine,
    #[serde(default)]
    pub errors: Vec<SphereErrors>,
    #[serde(default)]
    pub gpu_speed: Vec<GpuSpheres>,
}

#[derive(Clone, Debug, Deserialize)]
pub struct SphereErrors {
    pub family: String,
    pub pairs: u64,
    pub root_missed: u64,
    pub root_extra: u64,
}

#[derive(Clone, Debug, Deserialize)]
pub struct GpuSpheres {
    pub n: u64,
    /// One pair after the other in plain f32, one thread.
    pub plain_fps: Option<f64>,
    pub all_pairs_fps: Option<f64>,
}

/// A scene of `several-gpus.txt`: round trips, ms, the middle ones of the runs.
#[derive(Clone, Debug, PartialEq)]
pub struct TwoGpus {
    pub scene: String,
    pub one_ms: f64,
    pub two_ms: f64,
}

impl TwoGpus {
    /// Boxes: a million, but for the scene that is named by its number.
    pub fn boxes(&self) -> u32 {
        if self.scene == "ten million" { 10_000_000 } else { 1_000_000 }
    }
}
