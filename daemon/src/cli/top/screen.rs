//! The terminal: set up, drawn to, and left as it was, also after a panic or a signal.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event};
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};

use super::draw::{Source, Styles, draw};
use super::view::{Then, View};
use crate::cli::rates::Look;

/// Keys are waited for so long at a time: a signal is noticed as soon.
const LOOK_FOR_KEYS: Duration = Duration::from_millis(100);

/// The second look comes after this time at the latest.
const FIRST_INTERVAL: Duration = Duration::from_millis(300);

/// The terminal of this process. It is restored when this is dropped; a hook of the library's does so before the message
/// of a panic is written.
pub struct Screen {
    terminal: DefaultTerminal,
    stop: Arc<AtomicBool>,
}

impl Screen {
    pub fn open() -> io::Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            signal_hook::flag::register(signal, Arc::clone(&stop))?;
        }
        Ok(Self { terminal: ratatui::try_init()?, stop })
    }

    /// Shows looks, one each interval, until the user quits or a signal comes.
    pub fn show<E: From<io::Error>>(
        &mut self,
        interval: Duration,
        styles: Styles,
        mut look: impl FnMut() -> Result<(Source, Option<Look>), E>,
    ) -> Result<(), E> {
        let mut view = View::default();
        let (mut source, first) = look()?;
        let (mut now, mut before) = (first.unwrap_or_default(), None);
        // There are no rates before the second look.
        let mut due = Instant::now() + interval.min(FIRST_INTERVAL);
        while !self.stop.load(Ordering::Relaxed) {
            let mut most_scroll = 0;
            let looks = (&now, before.as_ref());
            self.terminal.draw(|frame| most_scroll = draw(frame, looks, &source, &view, styles))?;
            view.scroll = view.scroll.min(most_scroll);
            if self.wait(due, &mut view)? == Then::Quit {
                return Ok(());
            }
            if Instant::now() >= due {
                due = Instant::now() + interval;
                let (next_source, next) = look()?;
                if !view.is_paused {
                    source = next_source;
                    if let Some(next) = next {
                        before = Some(std::mem::replace(&mut now, next));
                    }
                }
            }
        }
        Ok(())
    }

    /// Waits until then, or until a key has changed the view.
    fn wait(&self, due: Instant, view: &mut View) -> io::Result<Then> {
        loop {
            let left = due.saturating_duration_since(Instant::now());
            if left.is_zero() || self.stop.load(Ordering::Relaxed) {
                return Ok(Then::GoOn);
            }
            let has_event = match event::poll(left.min(LOOK_FOR_KEYS)) {
                Err(error) if error.kind() == io::ErrorKind::Interrupted => false,
                has_event => has_event?,
            };
            if !has_event {
                continue;
            }
            return match event::read()? {
                Event::Key(key) => Ok(view.press(key)),
                // The terminal has another size.
                _ => Ok(Then::GoOn),
            };
        }
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        // After a panic it was restored, and a second time would write over the message.
        if !std::thread::panicking() {
            // Nothing is left on which an error could be shown.
            let _ = ratatui::try_restore();
        }
    }
}
