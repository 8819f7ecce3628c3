//! What the user has chosen to see, and how keys change it: no terminal here.

use ratatui::crossterm::event::{KeyCode, KeyEvent, KeyEventKind, KeyModifiers};

use super::table::Selection;

/// Rows by which the page keys scroll.
const PAGE: usize = 10;
/// Length of a filter at most, characters: a line of the narrowest terminal.
const MOST_FILTER: usize = 40;

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct View {
    pub selection: Selection,
    /// Whether keys are letters of the filter.
    pub is_typing: bool,
    /// Rows that are above the table.
    pub scroll: usize,
    pub is_paused: bool,
    pub has_help: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Then {
    GoOn,
    Quit,
}

impl View {
    pub fn press(&mut self, key: KeyEvent) -> Then {
        if key.kind == KeyEventKind::Release {
            return Then::GoOn;
        }
        let is_control = key.modifiers.contains(KeyModifiers::CONTROL);
        match key.code {
            KeyCode::Char('c') if is_control => return Then::Quit,
            _ if is_control => {}
            code if self.is_typing => self.type_key(code),
            KeyCode::Char('q') => return Then::Quit,
            KeyCode::Esc if self.has_help => self.has_help = false,
            KeyCode::Esc if self.selection.filter.is_empty() => return Then::Quit,
            KeyCode::Esc => self.selection.filter.clear(),
            KeyCode::Char('s') => {
                self.selection.sort = self.selection.sort.next();
                self.scroll = 0;
            }
            KeyCode::Char('r') => self.selection.is_reversed = !self.selection.is_reversed,
            KeyCode::Char('/' | 'f') => (self.is_typing, self.scroll) = (true, 0),
            KeyCode::Char('p' | ' ') => self.is_paused = !self.is_paused,
            KeyCode::Char('h' | '?') => self.has_help = !self.has_help,
            KeyCode::Up | KeyCode::Char('k') => self.scroll = self.scroll.saturating_sub(1),
            KeyCode::Down | KeyCode::Char('j') => self.scroll = self.scroll.saturating_add(1),
            KeyCode::PageUp => self.scroll = self.scroll.saturating_sub(PAGE),
            KeyCode::PageDown => self.scroll = self.scroll.saturating_add(PAGE),
            KeyCode::Home => self.scroll = 0,
            // How far that is, is known where it is drawn.
            KeyCode::End => self.scroll = usize::MAX,
            _ => {}
        }
        Then::GoOn
    }

    fn type_key(&mut self, code: KeyCode) {
        let filter = &mut self.selection.filter;
        match code {
            KeyCode::Enter => self.is_typing = false,
            KeyCode::Esc => {
                filter.clear();
                self.is_typing = false;
            }
            KeyCode::Backspace => _ = filter.pop(),
            KeyCode::Char(c) if filter.chars().count() < MOST_FILTER && !c.is_control() => {
                filter.push(c);
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::top::table::SortKey;

    fn press(view: &mut View, keys: &[KeyCode]) -> Then {
        let pressed = keys.iter().map(|code| view.press(KeyEvent::new(*code, KeyModifiers::NONE)));
        pressed.last().unwrap_or(Then::GoOn)
    }

    #[test]
    fn keys_sort_filter_scroll_and_quit() {
        use KeyCode::{Backspace, Char, Down, End, Enter, Esc, PageUp};
        let mut view = View::default();
        press(&mut view, &[Char('s'), Char('r'), Char(' ')]);
        assert_eq!((view.selection.sort, view.selection.is_reversed), (SortKey::Frames, true));
        assert!(view.is_paused);
        let typed = [Char('/'), Char('q'), Char('s'), Backspace, Char('x')];
        assert_eq!(press(&mut view, &typed), Then::GoOn, "a letter of the filter");
        assert!(view.is_typing && view.selection.filter == "qx");
        press(&mut view, &[Enter, Down, Down]);
        assert_eq!((view.is_typing, view.scroll), (false, 2));
        press(&mut view, &[Esc]);
        assert_eq!(view.selection.filter, "");
        press(&mut view, &[End, Down]);
        assert!(view.scroll > 1_000_000, "as far as there are rows");
        view.scroll = 30;
        press(&mut view, &[PageUp]);
        assert_eq!(view.scroll, 20);
        assert_eq!(press(&mut view, &[Char('?'), Esc]), Then::GoOn);
        assert_eq!(press(&mut view, &[Char('q')]), Then::Quit);
        assert_eq!(press(&mut view, &[Esc]), Then::Quit);
        view.is_typing = true;
        let interrupt = KeyEvent::new(Char('c'), KeyModifiers::CONTROL);
        assert_eq!(view.press(interrupt), Then::Quit);
    }
}
