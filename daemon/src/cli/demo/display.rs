//! The demo's output: one line that is rewritten on a terminal, else a line a second.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use pairmask_core::engine::EngineId;
use pairmask_core::oracle::check::Mismatch;

use crate::cli::output::{OutputError, is_watched, print_text, time_text};
use crate::cli::percentiles::Recorder;

/// Time between two changes of the line on a terminal: faster figures cannot be read.
const LIVE_INTERVAL: Duration = Duration::from_millis(250);
const PLAIN_INTERVAL: Duration = Duration::from_secs(1);

/// Frames, and what they took.
#[derive(Debug)]
struct Tally {
    since: Instant,
    frames: u64,
    pairs: u64,
    round_trips: Recorder,
}

impl Tally {
    fn new() -> Self {
        Self { since: Instant::now(), frames: 0, pairs: 0, round_trips: Recorder::new() }
    }

    fn note(&mut self, pairs: u64, ns: u64) {
        self.frames += 1;
        self.pairs += pairs;
        self.round_trips.record(ns);
    }

    fn frames_a_second(&self) -> f64 {
        self.frames as f64 / self.since.elapsed().as_secs_f64().max(1e-9)
    }

    fn text(&self) -> String {
        let found = self.round_trips.percentiles();
        format!(
            "{:>7.0} frames/s  {:>6} pairs  round trip p50 {:>9} p99 {:>9}",
            self.frames_a_second(),
            self.pairs / self.frames.max(1),
            time_text(found.p50),
            time_text(found.p99),
        )
    }
}

/// Counts of the whole run, and since the display last changed.
#[derive(Debug)]
pub struct Progress {
    all: Tally,
    recent: Tally,
    frames_in_process: u64,
    engine: Option<EngineId>,
    checked: u64,
    wrong: u64,
    first_wrong: Option<(u64, Mismatch)>,
}

impl Progress {
    pub fn new() -> Self {
        Self {
            all: Tally::new(),
            recent: Tally::new(),
            frames_in_process: 0,
            engine: None,
            checked: 0,
            wrong: 0,
            first_wrong: None,
        }
    }

    pub fn elapsed(&self) -> Duration {
        self.all.since.elapsed()
    }

    pub fn note_frame(
        &mut self,
        pairs: u64,
        round_trip: Duration,
        engine: EngineId,
        in_process: bool,
    ) {
        let ns = round_trip.as_nanos() as u64;
        self.frames_in_process += u64::from(in_process);
        self.engine = Some(engine);
        self.all.note(pairs, ns);
        self.recent.note(pairs, ns);
    }

    /// Counts a checked frame: the last one.
    pub fn note_check(&mut self, bad: Option<Mismatch>) {
        self.checked += 1;
        if let Some(bad) = bad {
            self.wrong += 1;
            self.first_wrong.get_or_insert((self.all.frames, bad));
        }
    }

    /// Returns an error if a checked frame was wrong.
    pub fn verdict(&self) -> Result<(), WrongFrames> {
        match self.wrong {
            0 => Ok(()),
            wrong => Err(WrongFrames { wrong, checked: self.checked }),
        }
    }

    fn checks_text(&self) -> String {
        match &self.first_wrong {
            None => format!("{} frames checked, all right", self.checked),
            Some((frame, bad)) => format!(
                "{} of {} checked frames WRONG, the first is frame {frame}: {bad}",
                self.wrong, self.checked
            ),
        }
    }

    fn summary_text(&self) -> String {
        let (all, seconds) = (&self.all, self.elapsed().as_secs_f64());
        let found = all.round_trips.percentiles();
        let engine = self.engine.map_or_else(|| "none".to_owned(), |engine| engine.to_string());
        format!(
            "frames      {} in {seconds:.1} s ({:.0} a second), {} of them in process\n\
             pairs       {} a frame, engine {engine}\n\
             round trip  p50 {}, p99 {}, max {}\n\
             checks      {}",
            all.frames,
            all.frames_a_second(),
            self.frames_in_process,
            all.pairs / all.frames.max(1),
            time_text(found.p50),
            time_text(found.p99),
            time_text(found.max),
            self.checks_text(),
        )
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{wrong} of {checked} sampled frames were wrong: please report this")]
pub struct WrongFrames {
    wrong: u64,
    checked: u64,
}

#[derive(Debug)]
pub struct Display {
    /// The line on the terminal, if stderr is one.
    live: Option<ProgressBar>,
    due: Instant,
}

impl Display {
    pub fn new() -> Self {
        let live = is_watched().then(|| {
            let style = ProgressStyle::with_template("{spinner} {msg}");
            ProgressBar::new_spinner()
                .with_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()))
        });
        let mut display = Self { live, due: Instant::now() };
        display.due += display.interval();
        display
    }

    const fn interval(&self) -> Duration {
        if self.live.is_some() { LIVE_INTERVAL } else { PLAIN_INTERVAL }
    }

    pub fn update(&mut self, progress: &mut Progress) -> Result<(), OutputError> {
        if Instant::now() < self.due {
            return Ok(());
        }
        self.due = Instant::now() + self.interval();
        let text = format!(
            "{:>5.1} s  {}  {}",
            progress.elapsed().as_secs_f64(),
            progress.recent.text(),
            progress.checks_text()
        );
        progress.recent = Tally::new();
        match &self.live {
            Some(line) => {
                line.set_message(text);
                line.tick();
                Ok(())
            }
            None => print_text(&text),
        }
    }

    pub fn summary(&self, progress: &Progress) -> Result<(), OutputError> {
        if let Some(line) = &self.live {
            line.finish_and_clear();
        }
        print_text(&progress.summary_text())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_frame_is_named_and_fails() {
        let mut progress = Progress::new();
        let engine = pairmask_core::EngineName::CpuBrute.into();
        progress.note_frame(3, Duration::from_micros(40), engine, false);
        progress.note_check(None);
        assert!(progress.verdict().is_ok());
        assert!(progress.summary_text().contains("1 frames checked, all right"));
        progress.note_frame(3, Duration::from_micros(40), engine, false);
        progress.note_check(Some(Mismatch::Missing([3, 9])));
        let text = progress.summary_text();
        assert!(text.contains("frame 2") && text.contains("[3, 9]"), "{text}");
        assert_eq!(progress.verdict(), Err(WrongFrames { wrong: 1, checked: 2 }));
    }
}
