//! The terminal, drawn on as a whole. It is as before when this is dropped, after a panic or a signal too.

use std::io::{self, IsTerminal};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use ratatui::crossterm::event::{self, Event, KeyEvent};
use ratatui::{DefaultTerminal, Frame};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;
use signal_hook::consts::{SIGINT, SIGTERM};

/// Keys are waited for so long at a time: a signal is noticed as soon.
const LOOK_FOR_KEYS: Duration = Duration::from_millis(100);

/// Whether there is a terminal that can be drawn on, with keys.
pub fn can_draw() -> bool {
    let is_dumb = std::env::var_os("TERM").is_none_or(|name| name.is_empty() || name == "dumb");
    io::stdout().is_terminal() && io::stdin().is_terminal() && !is_dumb
}

/// Whether its user has nothing against colours.
pub fn has_colours() -> bool {
    std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
}

/// The terminal of this process. A hook of the library's restores it before the message of a panic is written.
pub struct Screen {
    terminal: DefaultTerminal,
    stop: Arc<AtomicBool>,
    log_level: log::LevelFilter,
}

/// What a wait has ended by.
pub enum Waited {
    /// It is time.
    Due,
    /// A key.
    Key(KeyEvent),
    /// The terminal has another size, say: it is to be drawn anew.
    Other,
    /// A signal that ends programs, or the terminal is gone.
    Stop,
}

impl Screen {
    /// Takes the terminal over. Nothing is logged meanwhile: lines would go across the picture.
    pub fn open() -> io::Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        // By SIGHUP, which says that the terminal is gone, the process ends at once.
        for signal in [SIGINT, SIGTERM] {
            signal_hook::flag::register(signal, Arc::clone(&stop))?;
        }
        let log_level = log::max_level();
        let terminal = ratatui::try_init()?;
        log::set_max_level(log::LevelFilter::Off);
        Ok(Self { terminal, stop, log_level })
    }

    pub fn draw(&mut self, draw: impl FnOnce(&mut Frame<'_>)) -> io::Result<()> {
        self.terminal.draw(draw).map(drop)
    }

    /// Waits until then, or until something comes. In this mode Ctrl-C is a key.
    pub fn wait(&self, due: Instant) -> io::Result<Waited> {
        loop {
            if self.stop.load(Ordering::Relaxed) {
                return Ok(Waited::Stop);
            }
            let left = due.saturating_duration_since(Instant::now());
            // Of a terminal that is gone the library would read the end for ever.
            if !has_terminal(left.min(LOOK_FOR_KEYS))? {
                return Ok(Waited::Stop);
            }
            if event::poll(Duration::ZERO)? {
                return Ok(match event::read()? {
                    Event::Key(key) => Waited::Key(key),
                    _ => Waited::Other,
                });
            }
            if left.is_zero() {
                return Ok(Waited::Due);
            }
        }
    }
}

/// Waits for a key for so long. Whether the terminal is there still.
fn has_terminal(longest: Duration) -> io::Result<bool> {
    let stdin = io::stdin();
    let mut keys = [PollFd::new(&stdin, PollFlags::IN)];
    let longest = Timespec { tv_sec: 0, tv_nsec: longest.subsec_nanos().into() };
    match poll(&mut keys, Some(&longest)) {
        Ok(_) | Err(Errno::INTR) => {}
        Err(error) => return Err(error.into()),
    }
    Ok(!keys[0].revents().intersects(PollFlags::HUP | PollFlags::ERR | PollFlags::NVAL))
}

impl Drop for Screen {
    fn drop(&mut self) {
        // After a panic it was restored, and a second time would write over the message.
        if !std::thread::panicking() {
            // Nothing is left on which an error could be shown.
            let _ = ratatui::try_restore();
        }
        log::set_max_level(self.log_level);
    }
}
