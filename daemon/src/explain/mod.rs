//! Explains why a pair of boxes is in the mask or not: classes, the gap on each axis in units and
//! in ulps, the boxes in a precision mode's form, and their cells in `cpu-grid`.

mod sent;
mod text;

pub use self::sent::{SentBoxes, SentReport};

use pairmask_core::aabb::order_key;
use pairmask_core::engine::grid::{self, GridPlace};
use pairmask_core::{Aabb, BoxClass, BoxCount, PairIndex};
use serde::Serialize;

/// The JSON object of `explain --json`. Fields may be added, never changed or taken away.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Explanation {
    /// The indices of the two boxes, in the order given.
    pub pair: [u32; 2],
    pub boxes: u32,
    /// Whether the pair is in the mask.
    pub overlaps: bool,
    /// Why, in one sentence.
    pub reason: String,
    /// `exact`, or the name of the precision mode.
    pub mode: String,
    /// The pair index k, the pair's bit in a dense mask; null for a box with itself.
    pub pair_index: Option<u64>,
    pub box_reports: [BoxReport; 2],
    /// The three axes; null unless both boxes are solid.
    pub axes: Option<[AxisReport; 3]>,
    /// The two boxes in the mode's form; null for `exact`.
    pub sent: Option<SentReport>,
    /// The two boxes in the grid of `cpu-grid`, as they are sent.
    pub grid: GridReport,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BoxReport {
    pub index: u32,
    /// `solid`, `empty` or `invalid`.
    pub class: &'static str,
    /// Its six coordinates as text, since JSON has neither NaN nor infinity; exact.
    pub coordinates: [String; 6],
    /// Their bits, hexadecimal.
    pub bits: [String; 6],
}

/// The two boxes in the grid of `cpu-grid`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GridReport {
    /// Levels of the scene.
    pub levels: u32,
    /// Whether `cpu-grid` compares the two boxes.
    pub compared: bool,
    /// The cells of each box; null for one that overlaps nothing.
    pub places: [Option<PlaceReport>; 2],
}

/// The cells of a box in the grid.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlaceReport {
    /// Its level, 0 for the finest.
    pub level: u32,
    /// The cell of its min corner.
    pub first_cell: [i32; 3],
    /// The cell of its max corner.
    pub last_cell: [i32; 3],
    /// Approximate edges of a cell: in units, or in cells of the mode where boxes are sent as
    /// cells.
    pub cell_edges: [f32; 3],
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ExplainError {
    #[error("there is no box {index}: the scene has {boxes}, numbered from 0")]
    NoSuchBox { index: u32, boxes: usize },
}

impl Explanation {
    /// Explains boxes `i` and `j` of a scene.
    ///
    /// ```
    /// use pairmask_core::Aabb;
    /// use pairmaskd::explain::Explanation;
    /// let boxes = [0.0, 2.0].map(|x| Aabb::from([x, 0.0, 0.0, x + 1.0, 1.0, 1.0]));
    /// let why = Explanation::of(&boxes, 0, 1)?;
    /// assert!(!why.overlaps);
    /// assert_eq!(why.reason, "a gap of 1 on x keeps the boxes apart");
    /// # Ok::<(), pairmaskd::explain::ExplainError>(())
    /// ```
    pub fn of(boxes: &[Aabb], i: u32, j: u32) -> Result<Self, ExplainError> {
        Self::of_sent(boxes, &SentBoxes::exact(boxes), i, j)
    }

    /// Explains boxes `i` and `j` of a scene that is sent with a precision mode.
    ///
    /// ```
    /// use pairmask_core::Aabb;
    /// use pairmaskd::explain::{Explanation, SentBoxes};
    /// let boxes = [0.0, 2.0, 9.0].map(|x| Aabb::from([x, 0.0, 0.0, x + 1.999, 1.0, 1.0]));
    /// let sent = "q8".parse()?;
    /// let sent = SentBoxes::of(sent, &boxes);
    /// let why = Explanation::of_sent(&boxes, &sent, 0, 1)?;
    /// assert!(why.overlaps && why.reason.ends_with("their cells meet: an extra pair of q8"));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn of_sent(
        boxes: &[Aabb],
        sent: &SentBoxes<'_>,
        i: u32,
        j: u32,
    ) -> Result<Self, ExplainError> {
        let find = |boxes: &[Aabb], index: u32| {
            let no_such_box = ExplainError::NoSuchBox { index, boxes: boxes.len() };
            boxes.get(index as usize).copied().ok_or(no_such_box)
        };
        let two = [find(boxes, i)?, find(boxes, j)?];
        let two_sent = [find(sent.boxes(), i)?, find(sent.boxes(), j)?];
        let axes = axes(&two);
        let n = boxes.len() as u32;
        let overlaps = |[a, b]: &[Aabb; 2]| i != j && a.overlaps(b);
        let view = grid::explain(sent.boxes(), i as usize, j as usize);
        let reason = reason(i, j, [&two[0], &two[1]], axes.as_ref());
        Ok(Self {
            pair: [i, j],
            boxes: n,
            overlaps: overlaps(&two_sent),
            reason: if i == j {
                reason
            } else {
                reason + &sent.verdict(overlaps(&two), overlaps(&two_sent))
            },
            mode: sent.mode.clone(),
            pair_index: PairIndex::of(BoxCount::new(n), i.min(j), i.max(j)).map(PairIndex::get),
            box_reports: [BoxReport::of(i, &two[0]), BoxReport::of(j, &two[1])],
            axes,
            sent: sent.report(&two_sent),
            grid: GridReport {
                levels: view.levels,
                compared: view.neighbours,
                places: view.places.map(|place| place.as_ref().map(PlaceReport::of)),
            },
        })
    }
}

/// Two boxes on the three axes, where both are solid.
fn axes([a, b]: &[Aabb; 2]) -> Option<[AxisReport; 3]> {
    let solid = [a, b].iter().all(|one| one.class() == BoxClass::Solid);
    solid.then(|| std::array::from_fn(|axis| AxisReport::of(a, b, axis)))
}

impl BoxReport {
    fn of(index: u32, one: &Aabb) -> Self {
        let coordinates = <[f32; 6]>::from(*one);
        Self {
            index,
            class: class_name(one.class()),
            coordinates: coordinates.map(|x| format!("{x:?}")),
            bits: coordinates.map(|x| format!("{:08x}", x.to_bits())),
        }
    }
}

impl PlaceReport {
    fn of(place: &GridPlace) -> Self {
        let GridPlace { level, first_cell, last_cell, cell_edges } = *place;
        Self { level, first_cell, last_cell, cell_edges }
    }
}

const fn class_name(class: BoxClass) -> &'static str {
    match class {
        BoxClass::Solid => "solid",
        BoxClass::Empty => "empty",
        BoxClass::Invalid => "invalid",
    }
}

fn reason(i: u32, j: u32, two: [&Aabb; 2], axes: Option<&[AxisReport; 3]>) -> String {
    if i == j {
        return "a box is no pair with itself".to_owned();
    }
    let Some(axes) = axes else {
        let (index, class) = if two[0].class() == BoxClass::Solid {
            (j, two[1].class())
        } else {
            (i, two[0].class())
        };
        let why = match class {
            BoxClass::Invalid => "has a NaN and so overlaps nothing",
            _ => "is empty (min above max) and so overlaps nothing",
        };
        return format!("box {index} {why}");
    };
    let apart: Vec<&AxisReport> =
        axes.iter().filter(|axis| axis.state == Separation::Apart).collect();
    match apart.as_slice() {
        [] if axes.iter().any(|axis| axis.state == Separation::Touching) => {
            "the boxes touch, and touching counts".to_owned()
        }
        [] => "the boxes overlap on all three axes".to_owned(),
        [one] => format!("a gap of {} on {} keeps the boxes apart", one.gap_text(), one.axis),
        many => {
            let gaps: Vec<String> =
                many.iter().map(|one| format!("{} on {}", one.gap_text(), one.axis)).collect();
            format!("gaps of {} keep the boxes apart", gaps.join(" and "))
        }
    }
}

/// How two intervals relate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Separation {
    Overlapping,
    Touching,
    Apart,
}

/// Two solid boxes on one axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AxisReport {
    /// `x`, `y` or `z`.
    pub axis: &'static str,
    pub state: Separation,
    /// Distance from the end of the interval that ends first to the start of the other, units.
    /// Below 0 the length of the overlap. Null where that is not finite.
    pub gap: Option<f64>,
    /// The same distance in steps of f32: 1 is the smallest gap.
    pub gap_ulps: i64,
    /// Start of the later interval.
    pub starts: String,
    /// End of the interval that ends first.
    pub ends: String,
}

impl AxisReport {
    /// Two solid boxes on axis 0, 1 or 2.
    fn of(a: &Aabb, b: &Aabb, axis: usize) -> Self {
        let key = |x: f32| i64::from(order_key(x.to_bits()));
        let starts = if key(a.min[axis]) >= key(b.min[axis]) { a.min[axis] } else { b.min[axis] };
        let ends = if key(a.max[axis]) <= key(b.max[axis]) { a.max[axis] } else { b.max[axis] };
        let gap_ulps = key(starts) - key(ends);
        // Exact unless the exponents differ by more than 28, and then to 53 bits.
        let gap = f64::from(starts) - f64::from(ends);
        Self {
            axis: ["x", "y", "z"][axis],
            state: match gap_ulps {
                ..0 => Separation::Overlapping,
                0 => Separation::Touching,
                1.. => Separation::Apart,
            },
            gap: gap.is_finite().then_some(gap),
            gap_ulps,
            starts: format!("{starts:?}"),
            ends: format!("{ends:?}"),
        }
    }

    /// The gap in units, or in words where it is not finite.
    pub fn gap_text(&self) -> String {
        match self.gap {
            Some(gap) => number(gap),
            None => "∞".to_owned(),
        }
    }
}

/// A number as text: seven digits, plain where that is short, else with an exponent.
fn number(x: f64) -> String {
    let x = format!("{x:.6e}").parse().unwrap_or(x);
    if x == 0.0 || (1e-4..1e9).contains(&x.abs()) { format!("{x}") } else { format!("{x:e}") }
}

#[cfg(test)]
mod tests;
