//! `scene`: writes the boxes of a named scene, for `cull` and `bench latency --scene`.

use std::path::PathBuf;

use clap::Args;

use super::object_files::{Format, write_objects};
use super::output::{check_binary, write_file};
use super::program::Result;
use super::progress::spinner;
use super::whole_number::whole_number;
use crate::scene::{Scene as Boxes, SceneName};

/// Write the boxes of a named scene to a file
#[derive(Debug, Args)]
#[command(after_help = "\
Little-endian f32, 24 bytes a box: min.x min.y min.z max.x max.y max.z; text, CSV or an array of numpy where
the name of the file ends with .txt, .csv or .npy. The same name, number and seed give the same bytes on
every machine.

Examples:
  pairmaskd scene uniform 100000 boxes.f32
  pairmaskd scene pile 10000 pile.f32 --seed 7
  pairmaskd cull pile.f32 --backend in-process
  pairmaskd scene torus 5000 torus.csv
  pairmaskd scene torus 5000 - | pairmaskd cull -")]
pub struct Scene {
    /// uniform, mixed, pile, plane, cubes, balls, skittles, torus, letters, one-cell, rods, giants,
    /// far or identical
    name: SceneName,
    /// Number of boxes
    #[arg(value_parser = whole_number::<u32>)]
    n: u32,
    /// File to write, `-` for stdout
    out: PathBuf,
    /// Another seed gives other boxes of the same kind
    #[arg(long, value_parser = whole_number::<u64>, default_value_t = 1)]
    seed: u64,
}

impl Scene {
    pub fn run(&self) -> Result {
        let format = Format::of(&self.out);
        if format.is_binary() {
            check_binary(&self.out, "name a file or a pipe")?;
        }
        let progress = spinner(&format!("{} boxes", self.n));
        let scene = Boxes::new(self.name, self.n as usize, self.seed);
        write_file(&self.out, |file| write_objects(file, format, scene.boxes()))?;
        progress.finish_and_clear();
        Ok(())
    }
}
