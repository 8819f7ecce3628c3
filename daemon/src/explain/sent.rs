//! The two boxes in the form that a precision mode sends.

use std::borrow::Cow;

use pairmask_core::precision::{Margin, Widening};
use pairmask_core::{Aabb, BoxForm, Precision};
use serde::Serialize;

use super::{AxisReport, axes};
use crate::precision::{PrecisionChoice, as_sent};

/// The boxes of a scene as engines get them, and the precision mode that made them.
#[derive(Clone, Debug)]
pub struct SentBoxes<'a> {
    boxes: Cow<'a, [Aabb]>,
    pub(super) mode: String,
    /// `None` where boxes are sent unchanged.
    form: Option<Form>,
}

#[derive(Clone, Debug)]
struct Form {
    /// The unit of the coordinates.
    unit: &'static str,
    rule: String,
    /// Edges of a cell, units; `None` where coordinates are no cells.
    cell_edges: Option<[f64; 3]>,
}

/// The two boxes in a mode's form.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SentReport {
    /// The unit of the coordinates: `cells`, `halves` or `f32`.
    pub unit: &'static str,
    /// What the mode does, and which extra pairs it may add, in words.
    pub rule: String,
    /// Six coordinates of each box as text: cells by their numbers, others in units.
    pub coordinates: [[String; 6]; 2],
    /// Edges of a cell on x, y and z, units; null where coordinates are no cells but units.
    pub cell_edges: Option<[f64; 3]>,
    /// The three axes as they are sent, in the same unit; null unless both boxes are solid.
    pub axes: Option<[AxisReport; 3]>,
}

impl<'a> SentBoxes<'a> {
    /// Boxes that are sent unchanged.
    pub fn exact(boxes: &'a [Aabb]) -> Self {
        Self { boxes: Cow::Borrowed(boxes), mode: "exact".to_owned(), form: None }
    }

    /// Boxes in a precision; cells divide the bounds of all boxes.
    pub fn of(choice: PrecisionChoice, boxes: &'a [Aabb]) -> Self {
        match choice {
            PrecisionChoice::Exact => Self::exact(boxes),
            PrecisionChoice::Margin(margin) => {
                let mut inflated = boxes.to_vec();
                choice.inflate(&mut inflated);
                Self::inflated(margin, inflated)
            }
            narrow => {
                let precision = narrow.precision(boxes);
                let sent = as_sent(&precision, boxes);
                Self::narrow(&precision, sent)
            }
        }
    }

    /// The boxes that [`as_sent`] returns for a precision.
    pub fn narrow(precision: &Precision, sent: impl Into<Cow<'a, [Aabb]>>) -> Self {
        let bounds = match precision {
            Precision::Q16(bounds) | Precision::Q8(bounds) => {
                let (low, high) = (bounds.low(), bounds.high());
                format!("cells of the bounds {low:?} to {high:?}; ")
            }
            Precision::Exact | Precision::F16 => String::new(),
        };
        let form = precision.form();
        Self {
            boxes: sent.into(),
            mode: form.as_str().to_owned(),
            form: Some(Form {
                unit: match form {
                    BoxForm::Q16 | BoxForm::Q8 => "cells",
                    BoxForm::F16 => "halves",
                    BoxForm::F32 => "f32",
                },
                rule: format!("{bounds}{}", precision.widening()),
                cell_edges: match precision.widening() {
                    Widening::Cells { size, .. } => Some(size),
                    Widening::None | Widening::Relative { .. } | Widening::Origin(_) => None,
                },
            }),
        }
    }

    pub fn inflated(margin: Margin, sent: impl Into<Cow<'a, [Aabb]>>) -> Self {
        let rule = format!("boxes are inflated by {}", margin.get());
        let mode = PrecisionChoice::Margin(margin).to_string();
        Self { boxes: sent.into(), mode, form: Some(Form { unit: "f32", rule, cell_edges: None }) }
    }

    /// Boxes of a world in f64, relative to an origin.
    pub fn relative(sent: &'a [Aabb]) -> Self {
        let rule = "boxes are relative to an origin, rounded outward".to_owned();
        let form = Some(Form { unit: "f32", rule, cell_edges: None });
        Self { boxes: Cow::Borrowed(sent), mode: "f64".to_owned(), form }
    }

    /// The boxes that engines get.
    pub fn boxes(&self) -> &[Aabb] {
        &self.boxes
    }

    /// The effect of the mode on the answer, as the end of the reason's sentence.
    pub(super) fn verdict(&self, overlaps: bool, overlaps_sent: bool) -> String {
        let Some(Form { unit, .. }) = self.form else { return String::new() };
        let (mode, sent) = (&self.mode, if unit == "f32" { "sent faces" } else { unit });
        match (overlaps, overlaps_sent) {
            (false, true) => format!(", but their {sent} meet: an extra pair of {mode}"),
            (true, false) => format!(", but their {sent} do not meet: {mode} misses the pair"),
            (true, true) | (false, false) => format!("; the same in {mode}"),
        }
    }

    pub(super) fn report(&self, two: &[Aabb; 2]) -> Option<SentReport> {
        let Form { unit, rule, cell_edges } = self.form.clone()?;
        let text = |x: f32| if unit == "cells" { format!("{x}") } else { format!("{x:?}") };
        Some(SentReport {
            unit,
            rule,
            coordinates: two.each_ref().map(|one| <[f32; 6]>::from(*one).map(text)),
            cell_edges,
            axes: axes(two),
        })
    }
}
