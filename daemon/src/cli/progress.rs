//! Progress of long work on stderr: a bar that is rewritten on a terminal, a line now and then elsewhere, for logs of
//! jobs. Nothing where only errors are logged (`-q`).

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressFinish, ProgressStyle};

use super::output::{is_watched, print_aside};
use crate::locked;

/// Time between two lines: work that is shorter has none, and an hour fits on some screens.
const LINE_INTERVAL: Duration = Duration::from_secs(10);

/// Progress of one piece of work, which ends with this.
#[derive(Debug)]
pub enum Progress {
    Bar(ProgressBar),
    Lines(Lines),
    Quiet,
}

/// Progress over `len` steps.
pub fn progress_bar(len: u64, what: &str) -> Progress {
    let style = ProgressStyle::with_template("{msg} {wide_bar} {percent} % {eta}")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    Progress::of(what, Some(len), || ProgressBar::new(len).with_style(style))
}

/// Progress of work whose length is not known.
pub fn spinner(what: &str) -> Progress {
    let progress = Progress::of(what, None, ProgressBar::new_spinner);
    if let Progress::Bar(spinner) = &progress {
        spinner.enable_steady_tick(Duration::from_millis(100));
    }
    progress
}

impl Progress {
    fn of(what: &str, len: Option<u64>, bar: impl FnOnce() -> ProgressBar) -> Self {
        if log::max_level() < log::Level::Warn {
            Self::Quiet
        } else if is_watched() {
            // Cleared at its end, also by an early return with an error.
            Self::Bar(bar().with_message(what.to_owned()).with_finish(ProgressFinish::AndClear))
        } else {
            Self::Lines(Lines::start(what, len, LINE_INTERVAL, |line| print_aside(&line)))
        }
    }

    pub fn set_position(&self, steps: u64) {
        match self {
            Self::Bar(bar) => bar.set_position(steps),
            Self::Lines(lines) => lines.state.steps.store(steps, Ordering::Relaxed),
            Self::Quiet => {}
        }
    }

    pub fn inc(&self, steps: u64) {
        match self {
            Self::Bar(bar) => bar.inc(steps),
            Self::Lines(lines) => {
                lines.state.steps.fetch_add(steps, Ordering::Relaxed);
            }
            Self::Quiet => {}
        }
    }

    pub fn set_message(&self, message: String) {
        match self {
            Self::Bar(bar) => bar.set_message(message),
            Self::Lines(lines) => *locked(&lines.state.message) = message,
            Self::Quiet => {}
        }
    }

    /// Ends it before other output.
    pub fn finish_and_clear(self) {
        if let Self::Bar(bar) = self {
            bar.finish_and_clear();
        }
    }
}

/// A thread that prints a line now and then, until this is dropped.
#[derive(Debug)]
pub struct Lines {
    state: Arc<State>,
    /// Closed to end the thread.
    ended: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug)]
struct State {
    message: Mutex<String>,
    steps: AtomicU64,
    len: Option<u64>,
    start: Instant,
}

impl State {
    fn line(&self) -> String {
        let (seconds, message) = (self.start.elapsed().as_secs(), locked(&self.message).clone());
        let steps = self.steps.load(Ordering::Relaxed);
        match self.len.filter(|len| *len > 0) {
            Some(len) => {
                let percent = 100.0 * (steps as f64 / len as f64).min(1.0);
                format!("{seconds} s, {percent:.0} %: {message}")
            }
            None => format!("{seconds} s: {message}"),
        }
    }
}

impl Lines {
    fn start(
        what: &str,
        len: Option<u64>,
        interval: Duration,
        mut print: impl FnMut(String) + Send + 'static,
    ) -> Self {
        let message = Mutex::new(what.to_owned());
        let state =
            Arc::new(State { message, steps: AtomicU64::new(0), len, start: Instant::now() });
        let (ended, end) = channel();
        let shared = Arc::clone(&state);
        let work = move || {
            while end.recv_timeout(interval) == Err(RecvTimeoutError::Timeout) {
                print(shared.line());
            }
        };
        // Work goes on without its progress where no thread can be started.
        let thread = std::thread::Builder::new().name("progress".to_owned()).spawn(work).ok();
        Self { state, ended: Some(ended), thread }
    }
}

impl Drop for Lines {
    fn drop(&mut self) {
        self.ended = None;
        if let Some(thread) = self.thread.take() {
            // A panic has said why, and took nothing but progress.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_comes_now_and_then_and_none_after_the_end() {
        let (sender, lines) = channel();
        let print = move |line| {
            let _ = sender.send(line);
        };
        let started = Lines::start("boxes", Some(200), Duration::from_millis(1), print);
        let progress = Progress::Lines(started);
        progress.set_position(40);
        progress.inc(10);
        let wait = Duration::from_secs(60);
        let has = |part: &str| {
            let end = Instant::now() + wait;
            while !lines.recv_timeout(wait).expect("a line").contains(part) {
                assert!(Instant::now() < end, "no line has '{part}'");
            }
        };
        has("25 %: boxes");
        progress.set_message("50 cases".to_owned());
        progress.set_position(1000);
        has("100 %: 50 cases");
        progress.finish_and_clear();
        // The channel ends with its thread: a thread that goes on would keep this loop waiting.
        while lines.recv().is_ok() {}
    }

    #[test]
    fn nothing_is_shown_where_nothing_is_logged() {
        assert!(log::max_level() < log::Level::Warn, "tests log nothing");
        assert!(matches!(spinner("x"), Progress::Quiet));
        let quiet = progress_bar(3, "x");
        quiet.inc(1);
        quiet.finish_and_clear();
    }
}
