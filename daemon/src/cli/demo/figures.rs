//! What the demo has counted and measured so far, and its texts.

use std::fmt;
use std::time::Duration;

use pairmask_core::engine::EngineId;
use serde_json::{Value, json};

use crate::cli::output::time_text;
use crate::percentiles::Recorder;

/// How the kill of the worker goes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kill {
    #[default]
    Ahead,
    /// Killed after so long; frames are answered in process until the next worker serves.
    Done { at: Duration },
    /// The next worker has answered a frame.
    Back { at: Duration },
}

#[derive(Clone, Debug)]
pub struct Figures {
    pub boxes: usize,
    pub length: Duration,
    pub elapsed: Duration,
    pub frames: u64,
    pub frames_in_process: u64,
    /// Of the last frame.
    pub pairs: u64,
    pub pairs_of_all: u64,
    pub engine: Option<EngineId>,
    /// Frames that were compared with all pairs, one by one, and were right.
    pub checked: u64,
    pub kill: Kill,
    pub ours: Recorder,
    pub parry: Recorder,
    pub naive: Recorder,
}

impl Figures {
    pub fn new(boxes: usize, length: Duration) -> Self {
        Self {
            boxes,
            length,
            elapsed: Duration::ZERO,
            frames: 0,
            frames_in_process: 0,
            pairs: 0,
            pairs_of_all: 0,
            engine: None,
            checked: 0,
            kill: Kill::default(),
            ours: Recorder::default(),
            parry: Recorder::default(),
            naive: Recorder::default(),
        }
    }

    /// Counts a frame, which took so long from boxes to pairs.
    pub fn note_frame(&mut self, pairs: u64, took: Duration, engine: EngineId, in_process: bool) {
        self.frames += 1;
        self.frames_in_process += u64::from(in_process);
        self.pairs = pairs;
        self.pairs_of_all += pairs;
        self.engine = Some(engine);
        self.ours.record(took.as_nanos() as u64);
        match self.kill {
            Kill::Done { at } if !in_process => self.kill = Kill::Back { at },
            _ => {}
        }
    }

    /// Median times of a frame: ours, and of each peer that was measured.
    pub fn medians(&self) -> Medians {
        let median = |recorder: &Recorder| Some(recorder.percentiles().p50).filter(|ns| *ns > 0);
        Medians { ours: median(&self.ours), parry: median(&self.parry), naive: median(&self.naive) }
    }

    pub fn engine_text(&self) -> String {
        self.engine.map_or_else(|| "no engine yet".to_owned(), |engine| engine.to_string())
    }

    /// A line of progress.
    pub fn line(&self) -> String {
        let times = self.ours.percentiles();
        format!(
            "{:>5.1} s  {} boxes  {:>6} pairs  {:>6} frames, none lost  a frame p50 {:>9} p99 {:>9}{}",
            self.elapsed.as_secs_f64(),
            self.boxes,
            self.pairs,
            self.frames,
            time_text(times.p50),
            time_text(times.p99),
            match self.kill {
                Kill::Ahead => "",
                Kill::Done { .. } => "  the worker is killed",
                Kill::Back { .. } => "  the next worker serves",
            },
        )
    }

    pub fn json(&self) -> Value {
        let times = self.ours.percentiles();
        let Medians { parry, naive, .. } = self.medians();
        json!({
            "boxes": self.boxes,
            "seconds": self.elapsed.as_secs_f64(),
            "frames": self.frames,
            "frames_in_process": self.frames_in_process,
            "checked": self.checked,
            "pairs": self.pairs_of_all / self.frames.max(1),
            "engine": self.engine.map(|engine| engine.to_string()),
            "worker_killed": self.kill != Kill::Ahead,
            "frame_ns": times,
            "parry3d_ns": parry,
            "naive_ns": naive,
        })
    }
}

/// Median times of a frame, ns; none where nothing was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Medians {
    pub ours: Option<u64>,
    pub parry: Option<u64>,
    pub naive: Option<u64>,
}

impl Medians {
    /// How many of our frames another one's takes.
    pub fn ratio(&self, other: Option<u64>) -> Option<f64> {
        Some(other? as f64 / self.ours? as f64)
    }

    /// The machine in words: `6.1 × parry3d, 93 × a naive loop`.
    pub fn machine(&self) -> String {
        let of = |time, name: &str| Some(format!("{} {name}", ratio_text(self.ratio(time)?)));
        let both = [of(self.parry, "parry3d"), of(self.naive, "a naive loop")];
        let known: Vec<String> = both.into_iter().flatten().collect();
        if known.is_empty() { "not measured yet".to_owned() } else { known.join(", ") }
    }
}

pub fn ratio_text(ratio: f64) -> String {
    if ratio < 10.0 { format!("{ratio:.1} ×") } else { format!("{ratio:.0} ×") }
}

impl fmt::Display for Figures {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (times, medians) = (self.ours.percentiles(), self.medians());
        let of = |ns: Option<u64>| ns.map_or_else(|| "none".to_owned(), time_text);
        writeln!(
            f,
            "frames        {} in {:.1} s, none lost, {} of them in process",
            self.frames,
            self.elapsed.as_secs_f64(),
            self.frames_in_process
        )?;
        match self.kill {
            Kill::Ahead => {}
            Kill::Done { at } => writeln!(f, "worker        killed at {:.1} s", at.as_secs_f64())?,
            Kill::Back { at } => writeln!(
                f,
                "worker        killed at {:.1} s, and another took its place",
                at.as_secs_f64()
            )?,
        }
        writeln!(
            f,
            "pairs         {} a frame of {} boxes, by {}",
            self.pairs_of_all / self.frames.max(1),
            self.boxes,
            self.engine_text()
        )?;
        writeln!(
            f,
            "a frame       p50 {}, p99 {}, max {}; parry3d {}, a naive loop {}",
            time_text(times.p50),
            time_text(times.p99),
            time_text(times.max),
            of(medians.parry),
            of(medians.naive)
        )?;
        writeln!(f, "this machine  {} (one thread each)", medians.machine())?;
        write!(f, "checks        {} frames checked, all right", self.checked)
    }
}

#[cfg(test)]
mod tests {
    use pairmask_core::EngineName;

    use super::*;

    fn figures() -> Figures {
        let mut figures = Figures::new(4000, Duration::from_secs(10));
        let engine = EngineName::CpuGrid.into();
        for _ in 0..3 {
            figures.note_frame(9000, Duration::from_micros(100), engine, false);
        }
        figures.elapsed = Duration::from_secs(5);
        figures
    }

    #[test]
    fn a_kill_ends_with_the_next_workers_first_frame() {
        let (mut figures, engine) = (figures(), EngineName::CpuGrid.into());
        let at = figures.elapsed;
        figures.kill = Kill::Done { at };
        figures.note_frame(9000, Duration::from_micros(100), engine, true);
        assert_eq!((figures.kill, figures.frames_in_process), (Kill::Done { at }, 1));
        assert!(figures.line().contains("the worker is killed"));
        figures.note_frame(9000, Duration::from_micros(100), engine, false);
        assert_eq!(figures.kill, Kill::Back { at });
        let text = figures.to_string();
        assert!(text.contains("5 in 5.0 s, none lost, 1 of them in process"), "{text}");
        assert!(text.contains("killed at 5.0 s, and another took its place"), "{text}");
    }

    #[test]
    fn ratios_are_of_medians_and_absent_where_nothing_was_measured() {
        let mut figures = figures();
        assert_eq!(figures.medians().machine(), "not measured yet");
        figures.parry.record(610_000);
        figures.naive.record(9_300_000);
        let machine = figures.medians().machine();
        assert_eq!(machine, "6.1 × parry3d, 93 × a naive loop");
        assert!(
            figures.to_string().contains(&format!("this machine  {machine} (one thread each)"))
        );
        assert_eq!(figures.json()["pairs"], 9000);
    }
}
