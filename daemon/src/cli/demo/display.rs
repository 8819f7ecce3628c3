//! The demo's output: one line that is rewritten on a terminal, else a line a second.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use pairmask_core::engine::EngineId;
use pairmask_core::oracle::check::Mismatch;

use crate::cli::output::{OutputError, is_watched, print_text, time_text};
use crate::cli::percentiles::Recorder;
use crate::cli::program::Result;

/// Time between two changes of the line on a terminal: faster figures cannot be read.
const LIVE_INTERVAL: Duration = Duration::from_millis(250);
const PLAIN_INTERVAL: Duration = Duration::from_secs(1);

#[derive(Debug)]
struct Tally {
    since: Instant,
    frames: u64,
    pairs: u64,
    round_trips: Recorder,
}

impl Tally {
    fn new() -> Self {
        Self { since: Instant::now(), frames: 0, pairs: 0, round_trips: Recorder::default() }
    }

    fn frames_a_second(&self) -> f64 {
        self.frames as f64 / self.since.elapsed().as_secs_f64().max(1e-9)
    }

    fn pairs_a_frame(&self) -> u64 {
        self.pairs / self.frames.max(1)
    }
}

#[derive(Debug)]
pub struct Display {
    live: Option<ProgressBar>,
    due: Instant,
    all: Tally,
    /// Since it last changed.
    recent: Tally,
    frames_in_process: u64,
    engine: Option<EngineId>,
    checked: u64,
    wrong: u64,
    first_wrong: Option<(u64, Mismatch)>,
}

impl Display {
    pub fn new() -> Self {
        let live = is_watched().then(|| {
            let style = ProgressStyle::with_template("{spinner} {msg}");
            ProgressBar::new_spinner()
                .with_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()))
        });
        let due = Instant::now() + if live.is_some() { LIVE_INTERVAL } else { PLAIN_INTERVAL };
        Self {
            live,
            due,
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
        self.frames_in_process += u64::from(in_process);
        self.engine = Some(engine);
        for tally in [&mut self.all, &mut self.recent] {
            tally.frames += 1;
            tally.pairs += pairs;
            tally.round_trips.record(round_trip.as_nanos() as u64);
        }
    }

    pub fn note_check(&mut self, bad: Option<Mismatch>) {
        self.checked += 1;
        if let Some(bad) = bad {
            self.wrong += 1;
            self.first_wrong.get_or_insert((self.all.frames, bad));
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

    pub fn update(&mut self) -> Result<(), OutputError> {
        if Instant::now() < self.due {
            return Ok(());
        }
        let recent = std::mem::replace(&mut self.recent, Tally::new());
        let found = recent.round_trips.percentiles();
        let text = format!(
            "{:>5.1} s  {:>7.0} frames/s  {:>6} pairs  round trip p50 {:>9} p99 {:>9}  {}",
            self.elapsed().as_secs_f64(),
            recent.frames_a_second(),
            recent.pairs_a_frame(),
            time_text(found.p50),
            time_text(found.p99),
            self.checks_text()
        );
        if let Some(line) = &self.live {
            self.due = Instant::now() + LIVE_INTERVAL;
            line.set_message(text);
            line.tick();
            Ok(())
        } else {
            self.due = Instant::now() + PLAIN_INTERVAL;
            print_text(&text)
        }
    }

    fn summary(&self) -> String {
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
            all.pairs_a_frame(),
            time_text(found.p50),
            time_text(found.p99),
            time_text(found.max),
            self.checks_text(),
        )
    }

    /// Prints the summary. A checked frame that was wrong is an error.
    pub fn end(&self) -> Result {
        if let Some(line) = &self.live {
            line.finish_and_clear();
        }
        print_text(&self.summary())?;
        match (self.wrong, self.checked) {
            (0, _) => Ok(()),
            (wrong, checked) => {
                let text =
                    format!("{wrong} of {checked} sampled frames were wrong: please report this");
                Err(text.into())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrong_frame_is_named_and_fails() {
        let mut display = Display::new();
        let engine = pairmask_core::EngineName::CpuBrute.into();
        display.note_frame(3, Duration::from_micros(40), engine, false);
        display.note_check(None);
        assert!(display.end().is_ok());
        assert!(display.summary().contains("1 frames checked, all right"));
        display.note_frame(3, Duration::from_micros(40), engine, false);
        display.note_check(Some(Mismatch::Missing([3, 9])));
        let text = display.summary();
        assert!(text.contains("frame 2") && text.contains("[3, 9]"), "{text}");
        let error = display.end().expect_err("a wrong frame").to_string();
        assert!(error.starts_with("1 of 2 sampled frames were wrong"), "{error}");
    }
}
