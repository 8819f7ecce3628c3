//! Lower bounds of stages' times by their memory traffic.

use std::sync::Arc;
use std::time::Duration;

use pairmaskd::execute::gpu::{Block, Command, Frame, Gpu, GpuError, Home, Part, Wait};
use serde::Serialize;

use crate::gpu_stages::grid::GridRow;
use crate::study::harness::table::{Fields, row};

/// Highest bandwidths of a device, by its copy engine, GB/s.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Bandwidth {
    #[serde(rename = "up_gbs")]
    pub up: f64,
    #[serde(rename = "down_gbs")]
    pub down: f64,
    #[serde(rename = "memory_gbs")]
    pub memory: f64,
}

/// Bytes of a copy that is timed: several times a second-level cache.
const COPY_BYTES: u64 = 256 << 20;
/// The same on a software adapter.
const SOFTWARE_COPY_BYTES: u64 = 16 << 20;
/// Copies of which the fastest counts.
const COPIES: usize = 5;
/// Longest wait for one.
const PATIENCE: Duration = Duration::from_secs(10);

impl Bandwidth {
    pub fn measure(gpu: &Arc<Gpu>) -> Result<Self, GpuError> {
        let software = gpu.info().is_software();
        let bytes = if software { SOFTWARE_COPY_BYTES } else { COPY_BYTES };
        let wait = if software { Wait::Block } else { Wait::Spin };
        let block = |home| Block::new(gpu, home, bytes);
        let (host, video, other) = (block(Home::Host)?, block(Home::Video)?, block(Home::Video)?);
        let copy = |from: &Arc<Block>, to: &Arc<Block>| -> Result<f64, GpuError> {
            let part = |block| Part::of(block, 0, bytes);
            let mut frame = Frame::new(gpu, true)?;
            frame.record(vec![Command::Copy { from: part(from), to: part(to) }])?;
            let mut least_ns = f64::INFINITY;
            for _ in 0..COPIES {
                frame.run(wait, PATIENCE)?;
                let ns: f64 = frame.step_times()?.iter().map(|step| step.ns).sum();
                least_ns = least_ns.min(ns);
            }
            Ok(bytes as f64 / least_ns)
        };
        Ok(Self {
            up: copy(&host, &video)?,
            down: copy(&video, &host)?,
            memory: 2.0 * copy(&video, &other)?,
        })
    }
}

/// The stages of a measured scene.
pub fn stages(row: &GridRow, bandwidth: &Bandwidth) -> Vec<Fields> {
    let (n, cells, words) = (u64::from(row.n), u64::from(row.cells), row.words);
    let stage = |(stage, us): &(String, f64)| {
        // Up, down and video memory. Each box and each word counts once, each cell 4 bytes;
        // repeated reads (neighbours, crowded cells) are assumed to hit a cache.
        let (up, down, memory) = match stage.as_str() {
            "grid_cells" => (24 * n, 0, 32 * n + 8 * n),
            "grid_scan" => (0, 0, 8 * cells),
            "grid_scatter" => (0, 0, 24 * n),
            "grid_place" => (0, 0, 76 * n),
            "grid_pairs" => (0, 4 * n, 32 * n + 4 * cells + 12 * words),
            "grid_write" => (0, 12 * words, 12 * words + 4 * cells),
            _ => (0, 0, 0),
        };
        let ns = [
            up as f64 / bandwidth.up,
            down as f64 / bandwidth.down,
            memory as f64 / bandwidth.memory,
        ];
        row!(
            n: row.n,
            stage: stage.clone(),
            us: *us,
            link_bytes: up + down,
            memory_bytes: memory,
            floor_us: ns.into_iter().fold(0.0, f64::max) / 1e3,
        )
    };
    row.stage_us.iter().map(stage).collect()
}
