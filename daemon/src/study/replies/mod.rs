//! Forms of a sparse mask: how many bytes each takes, and what decoding it costs.
//!
//! A sparse mask has 12 bytes a word and, where the engine orders boxes, 4 bytes a box. The forms
//! here hold the same words in fewer bytes. They lie on no wire and serve no client: they settle
//! whether a denser form is worth one.
//!
//! The parts: [`MaskCopy`] is a mask that keeps every rule, and the encoders' input; [`Form`] names
//! the forms, one module each (`prefix`, `words64`, `packed`, `list`); [`Encoded`] is a mask in one
//! of them, decoded through one `sink`; [`check`] holds its pairs against the production decoder's;
//! [`measure`] weighs and times all forms of a scene; [`smallest`] says which is the smallest, and
//! what the link would gain.

mod check;
mod copy;
mod encoded;
mod form;
mod list;
mod measure;
mod packed;
mod prefix;
mod report;
mod sink;
mod smallest;
mod words64;

pub use check::check;
pub use copy::{CopyError, MaskCopy};
pub use encoded::Encoded;
pub use form::Form;
pub use measure::{FormRow, ReplyStudyError, measure};
pub use report::FormsReport;
pub use smallest::{OrderState, SmallestRow, smallest};
