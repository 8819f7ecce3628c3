//! The accuracy report as one page: plots and tables, no outside resources.

mod figures;
mod page;
mod papers;

pub use figures::{ModeVerdict, front_verdicts};
pub use page::html;
