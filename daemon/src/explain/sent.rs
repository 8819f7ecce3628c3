//! The two boxes in the form that a precision mode sends.

use std::borrow::Cow;

use pairmask_core::precision::{Margin, Widening};
use pairmask_core::{Aabb, BoxForm, Precision};
use serde_json::{Value, json};

use super::axis::{Separation, axes, number};
use super::corners;
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
    unit: &'static str,
    rule: String,
    /// Edges of a cell, units; `None` where coordinates are no cells.
    cell_edges: Option<[f64; 3]>,
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
                Self::narrow(&precision, as_sent(&precision, boxes))
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
        let (form, widening) = (precision.form(), precision.widening());
        let unit = match form {
            BoxForm::Q16 | BoxForm::Q8 => "cells",
            BoxForm::F16 => "halves",
            BoxForm::F32 => "f32",
        };
        let (rule, mode) = (format!("{bounds}{widening}"), form.as_str().to_owned());
        let cell_edges =
            if let Widening::Cells { size, .. } = widening { Some(size) } else { None };
        Self { boxes: sent.into(), mode, form: Some(Form { unit, rule, cell_edges }) }
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

    pub(super) fn cell_edges(&self) -> Option<[f64; 3]> {
        self.form.as_ref()?.cell_edges
    }

    pub(super) fn json(&self, two: &[Aabb; 2]) -> Option<Value> {
        let form = self.form.as_ref()?;
        Some(json!({
            "unit": form.unit,
            "rule": form.rule,
            "coordinates": two.map(|one| <[f32; 6]>::from(one).map(|x| form.text(x))),
            "cell_edges": form.cell_edges,
            "axes": axes(two),
        }))
    }

    /// The lines about the mode, and about the two boxes as they are sent.
    pub(super) fn lines(&self, [i, j]: [u32; 2], two: &[Aabb; 2]) -> Vec<String> {
        let mode = &self.mode;
        let Some(form) = &self.form else {
            return vec![format!("  mode      {mode}: boxes are compared as they are")];
        };
        let mut lines = vec![format!("  mode      {mode}: {}", form.rule)];
        lines.extend(self.box_line(i, &two[0]));
        lines.extend(self.box_line(j, &two[1]));
        for (k, axis) in axes(two).iter().flatten().enumerate() {
            let gap = axis.gap.map_or(f64::INFINITY, f64::abs);
            let gap = match form.cell_edges {
                Some(edges) => {
                    let plural = if gap == 1.0 { "" } else { "s" };
                    format!("{} cell{plural} ({} units)", number(gap), number(gap * edges[k]))
                }
                None => format!("{} units", number(gap)),
            };
            let how = match axis.state {
                Separation::Touching => "they meet".to_owned(),
                Separation::Apart => format!("apart by {gap}"),
                Separation::Overlapping => format!("overlapping by {gap}"),
            };
            lines.push(format!("  sent      {}  {how}", axis.axis));
        }
        lines
    }

    /// The line of one of the boxes as it is sent; `None` where it is sent unchanged.
    pub(super) fn box_line(&self, index: u32, one: &Aabb) -> Option<String> {
        let form = self.form.as_ref()?;
        let corners = corners(*one, |x| form.text(x));
        Some(format!("  sent      box {index}: {} {corners}", form.unit))
    }
}

impl Form {
    /// A coordinate: cells by their numbers, others in units.
    fn text(&self, x: f32) -> String {
        if self.unit == "cells" { format!("{x}") } else { format!("{x:?}") }
    }
}
