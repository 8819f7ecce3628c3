//! The terminal that the demo draws on. It is as before when this is dropped, after a panic too.

use std::io::{self, IsTerminal};
use std::time::Instant;

use ratatui::DefaultTerminal;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};

use super::drawing::draw;
use super::figures::Figures;
use super::world::World;

pub struct Screen {
    terminal: DefaultTerminal,
    log_level: log::LevelFilter,
}

/// Whether stdout is a terminal that can be drawn on, and its user has nothing against colours.
pub fn can_draw() -> bool {
    let is_set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    let is_dumb = std::env::var_os("TERM").is_none_or(|name| name.is_empty() || name == "dumb");
    std::io::stdout().is_terminal()
        && std::io::stdin().is_terminal()
        && !is_dumb
        && !is_set("NO_COLOR")
}

impl Screen {
    /// Takes the terminal over. Nothing is logged meanwhile: lines would go across the picture.
    pub fn open() -> io::Result<Self> {
        let log_level = log::max_level();
        let terminal = ratatui::try_init()?;
        log::set_max_level(log::LevelFilter::Off);
        Ok(Self { terminal, log_level })
    }

    pub fn draw(&mut self, world: &World, figures: &Figures) -> io::Result<()> {
        self.terminal.draw(|frame| draw(frame.buffer_mut(), world, figures)).map(drop)
    }

    /// Waits until `end`. Returns whether the user quits: q, Escape or Ctrl-C, which is a key here.
    pub fn wait(&self, end: Instant) -> io::Result<bool> {
        loop {
            let left = end.saturating_duration_since(Instant::now());
            if !event::poll(left)? {
                return Ok(false);
            }
            let Event::Key(key) = event::read()? else { continue };
            let is_quit = match key.code {
                KeyCode::Char('q') | KeyCode::Esc => true,
                KeyCode::Char('c') => key.modifiers.contains(KeyModifiers::CONTROL),
                _ => false,
            };
            if is_quit && key.kind != KeyEventKind::Release {
                return Ok(true);
            }
        }
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        ratatui::restore();
        log::set_max_level(self.log_level);
    }
}
