//! The accuracy report as one page: plots and tables, no outside resources.

mod choice;
mod figures;
mod page;
mod papers;

pub use page::html;
