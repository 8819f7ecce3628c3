//! `scene`: writes the boxes of a named scene, for `cull` and `bench latency --scene`.

use std::path::PathBuf;

use clap::Args;

use crate::scene::{Scene as Boxes, SceneName};

/// Write the boxes of a named scene to a file
#[derive(Debug, Args)]
#[command(after_help = "\
Little-endian f32, 24 bytes a box: min.x min.y min.z max.x max.y max.z. The same name, number and
seed give the same bytes on every machine.

Examples:
  pairmaskd scene uniform 100000 boxes.f32
  pairmaskd scene pile 10000 pile.f32 --seed 7
  pairmaskd cull pile.f32 --backend in-process")]
pub struct Scene {
    /// uniform, mixed, pile, plane, cubes, balls, skittles, torus, letters, one-cell, rods, giants,
    /// far or identical
    name: SceneName,
    /// Number of boxes
    n: u32,
    /// File to write
    out: PathBuf,
    /// Another seed gives other boxes of the same kind
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// The file was not written.
#[derive(Debug, thiserror::Error)]
#[error("{}: {source}", path.display())]
pub struct SceneCommandError {
    path: PathBuf,
    source: std::io::Error,
}

impl Scene {
    /// Writes the file.
    pub fn run(&self) -> Result<(), SceneCommandError> {
        let scene = Boxes::new(self.name, self.n as usize, self.seed);
        std::fs::write(&self.out, bytemuck::cast_slice::<_, u8>(scene.boxes()))
            .map_err(|source| SceneCommandError { path: self.out.clone(), source })
    }
}
