//! The study as text, and as the JSON that the README documents.

use std::fmt;

use serde::Serialize;

use super::errors::ErrorRow;
use super::gpu::{GpuErrorRow, GpuSpeedRow};
use super::speed::SpeedRow;
use crate::study::machine::Machine;

/// The JSON object of `spheres --json`. Fields may be added, never changed or taken away.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SphereReport {
    /// The machine of the measurement.
    pub machine: Machine,
    /// Frames a second by number of spheres.
    pub speed: Vec<SpeedRow>,
    /// Errors by family of pairs.
    pub errors: Vec<ErrorRow>,
    /// Frames a second on a GPU, where one was asked for.
    pub gpu_speed: Vec<GpuSpeedRow>,
    /// Pairs that a GPU decided, where one was asked for.
    pub gpu_errors: Vec<GpuErrorRow>,
}

impl SphereReport {
    /// Whether every pair was decided rightly, by the client library and on the GPU.
    pub fn is_exact(&self) -> bool {
        self.errors.iter().all(|row| row.exact_wrong == 0)
            && self.gpu_speed.iter().all(|row| row.is_right)
            && self.gpu_errors.iter().all(|row| row.wrong + row.beside_wrong == 0)
    }
}

impl fmt::Display for SphereReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}, {} threads", self.machine.cpu, self.machine.threads)?;
        if !self.speed.is_empty() {
            speed_table(f, &self.speed)?;
        }
        if !self.errors.is_empty() {
            error_table(f, &self.errors)?;
        }
        if !self.gpu_speed.is_empty() {
            gpu_speed_table(f, &self.gpu_speed)?;
        }
        if !self.gpu_errors.is_empty() {
            gpu_error_table(f, &self.gpu_errors)?;
        }
        Ok(())
    }
}

fn speed_table(f: &mut fmt::Formatter<'_>, rows: &[SpeedRow]) -> fmt::Result {
    writeln!(f, "\nAll pairs of spheres, frames a second (Suaib et al. 2015, table 1)\n")?;
    writeln!(
        f,
        "{:>8} {:>8} | {:>11} {:>11} {:>11} {:>8} {:>11} | {:>10} {:>10} {:>8}",
        "spheres",
        "pairs",
        "plain f32",
        "exact, 1",
        "exact, all",
        "speed-up",
        "engines",
        "paper seq",
        "paper par",
        "speed-up"
    )?;
    let paper = |x: Option<f64>| x.map_or_else(String::new, |x| format!("{x:.2}"));
    for row in rows {
        writeln!(
            f,
            "{:>8} {:>8} | {:>11} {:>11} {:>11} {:>8.2} {:>11} | {:>10} {:>10} {:>8}",
            row.n,
            row.pairs,
            fps(row.plain_fps),
            fps(row.sequential_fps),
            fps(row.parallel_fps),
            row.speed_up,
            fps(row.engines_fps),
            paper(row.paper_sequential_fps),
            paper(row.paper_parallel_fps),
            paper(row.paper_speed_up)
        )?;
    }
    Ok(())
}

fn fps(x: f64) -> String {
    if x >= 100.0 { format!("{x:.0}") } else { format!("{x:.2}") }
}

fn error_table(f: &mut fmt::Formatter<'_>, rows: &[ErrorRow]) -> fmt::Result {
    writeln!(f, "\nWrong decisions, against exact arithmetic\n")?;
    writeln!(
        f,
        "{:<23} {:>10} {:>10} | {:>6} | {:>10} {:>10} {:>9} | {:>10} {:>10} {:>9}",
        "pairs",
        "decided",
        "overlap",
        "exact",
        "f32 missed",
        "extra",
        "rate",
        "root missed",
        "extra",
        "rate"
    )?;
    for row in rows {
        let rate = |wrong: u64| format!("{:.2e}", wrong as f64 / row.pairs.max(1) as f64);
        writeln!(
            f,
            "{:<23} {:>10} {:>10} | {:>6} | {:>10} {:>10} {:>9} | {:>11} {:>10} {:>9}",
            row.family,
            row.pairs,
            row.overlapping,
            row.exact_wrong,
            row.f32_missed,
            row.f32_extra,
            rate(row.f32_missed + row.f32_extra),
            row.root_missed,
            row.root_extra,
            rate(row.root_missed + row.root_extra)
        )?;
    }
    Ok(())
}

fn gpu_speed_table(f: &mut fmt::Formatter<'_>, rows: &[GpuSpeedRow]) -> fmt::Result {
    writeln!(f, "\nSpheres on the GPU, frames a second (Suaib et al. 2015, table 1)\n")?;
    writeln!(
        f,
        "{:>8} {:>8} | {:>10} {:>10} {:>10} {:>8} | {:>10} {:>10} {:>10} | {:>9} {:>9} {:>8} | right",
        "spheres",
        "pairs",
        "one by one",
        "all pairs",
        "tests/s",
        "speed-up",
        "grid",
        "grid, us",
        "CPU",
        "paper seq",
        "paper par",
        "speed-up"
    )?;
    let or_none = |x: Option<f64>, text: fn(f64) -> String| x.map_or_else(String::new, text);
    let two: fn(f64) -> String = |x| format!("{x:.2}");
    for row in rows {
        writeln!(
            f,
            "{:>8} {:>8} | {:>10} {:>10} {:>10} {:>8} | {:>10} {:>10.1} {:>10} | {:>9} {:>9} {:>8} | {}",
            row.n,
            row.pairs,
            or_none(row.plain_fps, fps),
            or_none(row.all_pairs_fps, fps),
            or_none(row.tests_a_second, |x| format!("{x:.2e}")),
            or_none(row.speed_up, two),
            fps(row.grid_fps),
            row.grid_us,
            fps(row.cpu_fps),
            or_none(row.paper_sequential_fps, two),
            or_none(row.paper_parallel_fps, two),
            or_none(row.paper_speed_up, two),
            if row.is_right { "yes" } else { "NO" }
        )?;
    }
    Ok(())
}

fn gpu_error_table(f: &mut fmt::Formatter<'_>, rows: &[GpuErrorRow]) -> fmt::Result {
    writeln!(f, "\nDecided by the GPU, against exact arithmetic and the CPU\n")?;
    writeln!(
        f,
        "{:<23} {:>10} {:>6} | {:>16} {:>6}",
        "pairs", "decided", "wrong", "all beside them", "wrong"
    )?;
    for row in rows {
        writeln!(
            f,
            "{:<23} {:>10} {:>6} | {:>16} {:>6}",
            row.family, row.pairs, row.wrong, row.beside, row.beside_wrong
        )?;
    }
    Ok(())
}
