//! The demo's output: one line that is rewritten on a terminal, else a line a second.

use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use pairmask_core::engine::EngineId;

use crate::cli::output::{OutputError, is_watched, print_text, time_text};
use crate::cli::percentiles::Recorder;

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
    interval: Duration,
    due: Instant,
    all: Tally,
    /// Since it last changed.
    recent: Tally,
    frames_in_process: u64,
    engine: Option<EngineId>,
    checked: u64,
}

impl Display {
    pub fn new() -> Self {
        let live = is_watched().then(|| {
            let style = ProgressStyle::with_template("{spinner} {msg}");
            ProgressBar::new_spinner()
                .with_style(style.unwrap_or_else(|_| ProgressStyle::default_spinner()))
        });
        let interval = if live.is_some() { LIVE_INTERVAL } else { PLAIN_INTERVAL };
        Self {
            live,
            interval,
            due: Instant::now() + interval,
            all: Tally::new(),
            recent: Tally::new(),
            frames_in_process: 0,
            engine: None,
            checked: 0,
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

    /// Frames so far.
    pub fn frames(&self) -> u64 {
        self.all.frames
    }

    /// A frame was checked, and was right.
    pub fn note_check(&mut self) {
        self.checked += 1;
    }

    pub fn update(&mut self) -> Result<(), OutputError> {
        if Instant::now() < self.due {
            return Ok(());
        }
        let recent = std::mem::replace(&mut self.recent, Tally::new());
        let found = recent.round_trips.percentiles();
        let text = format!(
            "{:>5.1} s  {:>7.0} frames/s  {:>6} pairs  round trip p50 {:>9} p99 {:>9}  {} frames checked, all right",
            self.elapsed().as_secs_f64(),
            recent.frames_a_second(),
            recent.pairs_a_frame(),
            time_text(found.p50),
            time_text(found.p99),
            self.checked,
        );
        self.due = Instant::now() + self.interval;
        let Some(line) = &self.live else { return print_text(&text) };
        line.set_message(text);
        line.tick();
        Ok(())
    }

    fn summary(&self) -> String {
        let (all, seconds) = (&self.all, self.elapsed().as_secs_f64());
        let found = all.round_trips.percentiles();
        let engine = self.engine.map_or_else(|| "none".to_owned(), |engine| engine.to_string());
        format!(
            "frames      {} in {seconds:.1} s ({:.0} a second), {} of them in process\n\
             pairs       {} a frame, engine {engine}\n\
             round trip  p50 {}, p99 {}, max {}\n\
             checks      {} frames checked, all right",
            all.frames,
            all.frames_a_second(),
            self.frames_in_process,
            all.pairs_a_frame(),
            time_text(found.p50),
            time_text(found.p99),
            time_text(found.max),
            self.checked,
        )
    }

    /// Prints the summary.
    pub fn end(&self) -> Result<(), OutputError> {
        if let Some(line) = &self.live {
            line.finish_and_clear();
        }
        print_text(&self.summary())
    }
}
