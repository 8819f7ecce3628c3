//! Explains why a pair of boxes is in the mask or not: classes, the gap on each axis in units and
//! in ulps, the boxes in a precision mode's form, and their cells in `cpu-grid`.

mod axis;
mod sent;

pub use self::sent::SentBoxes;

use pairmask_core::engine::grid::{self, GridCell, GridView};
use pairmask_core::{Aabb, BoxClass, BoxCount, PairIndex};
use serde_json::{Value, json};

use self::axis::{AxisReport, Separation, axes, number};
use crate::shown::Shown;

struct Two<'a> {
    pair: [u32; 2],
    /// Of the scene.
    boxes: usize,
    given: [Aabb; 2],
    axes: Option<[AxisReport; 3]>,
    sent: &'a SentBoxes<'a>,
    as_sent: [Aabb; 2],
    /// The grid of `cpu-grid`, in which the two are as they are sent.
    grid: GridView,
}

/// Explains boxes `i` and `j` of a scene that is sent with a precision mode.
pub fn explain(boxes: &[Aabb], sent: &SentBoxes<'_>, i: u32, j: u32) -> Result<Shown, String> {
    let find = |boxes: &[Aabb], index: u32| {
        let no_such_box =
            || format!("there is no box {index}: the scene has {}, numbered from 0", boxes.len());
        boxes.get(index as usize).copied().ok_or_else(no_such_box)
    };
    let given = [find(boxes, i)?, find(boxes, j)?];
    let as_sent = [find(sent.boxes(), i)?, find(sent.boxes(), j)?];
    let (pair, axes) = ([i, j], axes(&given));
    let grid = grid::explain(sent.boxes(), i as usize, j as usize);
    let two = Two { pair, boxes: boxes.len(), given, axes, sent, as_sent, grid };
    let overlaps = |[a, b]: &[Aabb; 2]| i != j && a.overlaps(b);
    let mut reason = two.reason();
    if i != j {
        reason += &sent.verdict(overlaps(&given), overlaps(&as_sent));
    }
    let overlaps = overlaps(&as_sent);
    let fields = two.json(overlaps, &reason);
    let lines = if i == j { two.with_itself() } else { two.text(overlaps, &reason) };
    Ok(Shown { fields, text: lines.join("\n") })
}

const fn class_name(class: BoxClass) -> &'static str {
    match class {
        BoxClass::Valid => "valid",
        BoxClass::Empty => "empty",
        BoxClass::Invalid => "invalid",
    }
}

impl Two<'_> {
    fn reason(&self) -> String {
        let [i, j] = self.pair;
        if i == j {
            return "a box is no pair with itself".to_owned();
        }
        let Some(axes) = &self.axes else {
            let [first, second] = self.given.map(|one| one.class());
            let (index, class) = if first == BoxClass::Valid { (j, second) } else { (i, first) };
            let why = match class {
                BoxClass::Invalid => "has a NaN and so overlaps nothing",
                _ => "is empty (min above max) and so overlaps nothing",
            };
            return format!("box {index} {why}");
        };
        let apart = axes.iter().filter(|axis| axis.state == Separation::Apart);
        let gaps: Vec<String> =
            apart.map(|axis| format!("{} on {}", axis.gap_text(), axis.axis)).collect();
        match gaps.as_slice() {
            [] if axes.iter().any(|axis| axis.state == Separation::Touching) => {
                "the boxes touch, and touching counts".to_owned()
            }
            [] => "the boxes overlap on all three axes".to_owned(),
            [gap] => format!("a gap of {gap} keeps the boxes apart"),
            gaps => format!("gaps of {} keep the boxes apart", gaps.join(" and ")),
        }
    }

    /// The pair index, its bit in a dense mask; `None` for a box with itself.
    fn pair_index(&self) -> Option<u64> {
        let [i, j] = self.pair;
        let n = BoxCount::new(self.boxes as u32);
        PairIndex::of(n, i.min(j), i.max(j)).map(PairIndex::get)
    }

    fn json(&self, overlaps: bool, reason: &str) -> Value {
        let box_report = |slot: usize| {
            let coordinates = <[f32; 6]>::from(self.given[slot]);
            json!({
                "index": self.pair[slot],
                "class": class_name(self.given[slot].class()),
                // Text, since JSON has neither NaN nor infinity.
                "coordinates": coordinates.map(|x| format!("{x:?}")),
                "bits": coordinates.map(|x| format!("{:08x}", x.to_bits())),
            })
        };
        let slot = |slot: Option<GridCell>| {
            slot.map(|slot| {
                json!({
                    "level": slot.level,
                    "first_cell": slot.first_cell,
                    "last_cell": slot.last_cell,
                    "cell_edges": slot.cell_edges,
                })
            })
        };
        json!({
            "pair": self.pair,
            "boxes": self.boxes,
            "overlaps": overlaps,
            "reason": reason,
            "mode": self.sent.mode,
            "pair_index": self.pair_index(),
            "box_reports": ([0, 1].map(box_report)),
            "axes": self.axes,
            "sent": self.sent.json(&self.as_sent),
            "grid": {
                "levels": self.grid.levels,
                "compared": self.grid.neighbours,
                "homes": self.grid.homes.map(slot),
            },
        })
    }

    fn text(&self, overlaps: bool, reason: &str) -> Vec<String> {
        let Self { pair: [i, j], boxes, .. } = self;
        let verdict = if overlaps { "IN the mask" } else { "NOT in the mask" };
        let mut lines = vec![
            format!("Pair ({i}, {j}) of {boxes} boxes is {verdict}: {reason}."),
            String::new(),
            self.box_line(0),
            self.box_line(1),
        ];
        if let Some(axes) = &self.axes {
            lines.push(String::new());
            lines.extend(axes.iter().map(|axis| format!("  {}  {}", axis.axis, axis.sentence())));
        }
        lines.push(String::new());
        if let Some(k) = self.pair_index() {
            let (word, bit) = (k / 32, k % 32);
            lines.push(format!("  pair      number {k}: bit {bit} of word {word} of a dense mask"));
        }
        lines.extend(self.sent.lines(self.pair, &self.as_sent));
        lines.extend([0, 1].map(|slot| self.grid_line(slot)));
        if self.grid.homes.iter().all(Option::is_some) {
            let compared = if self.grid.neighbours {
                "neighbours: compared"
            } else {
                "far apart: not compared"
            };
            lines.push(format!("  cpu-grid  {compared}"));
        }
        lines
    }

    fn with_itself(&self) -> Vec<String> {
        let ([i, _], n) = (self.pair, self.boxes);
        let mut lines = vec![
            format!(
                "Box {i} of {n} boxes is no pair with itself: a mask holds pairs of two different boxes."
            ),
            String::new(),
            self.box_line(0),
        ];
        lines.extend(self.sent.box_line(i, &self.as_sent[0]));
        lines.push(self.grid_line(0));
        lines
    }

    fn box_line(&self, slot: usize) -> String {
        let (index, one) = (self.pair[slot], self.given[slot]);
        let line = format!("  box {index:<6} {}", corners(one, |x| format!("{x:?}")));
        match one.class() {
            BoxClass::Valid => line,
            class => format!("{line}  {}", class_name(class)),
        }
    }

    /// The line of a box's cells in the grid, whose unit is a cell of the mode in modes of cells.
    fn grid_line(&self, slot: usize) -> String {
        let index = self.pair[slot];
        let Some(slot) = self.grid.homes[slot] else {
            return format!("  cpu-grid  box {index} has no cell: it overlaps nothing");
        };
        let GridCell { level, first_cell, last_cell, cell_edges } = slot;
        let cells = [0, 1, 2].map(|axis| match (first_cell[axis], last_cell[axis]) {
            (first, last) if first == last => first.to_string(),
            (first, last) => format!("{first}..{last}"),
        });
        let unit = self.sent.cell_edges().unwrap_or([1.0; 3]);
        let edges = [0, 1, 2].map(|axis| number(f64::from(cell_edges[axis]) * unit[axis]));
        format!(
            "  cpu-grid  box {index}: level {level} of {}, cells ({}) of about {} units",
            self.grid.levels,
            cells.join(", "),
            edges.join(" × ")
        )
    }
}

fn corners(one: Aabb, text: impl Fn(f32) -> String) -> String {
    let [min, max] = [one.min, one.max].map(|corner| corner.map(&text).join(", "));
    format!("({min}) to ({max})")
}

#[cfg(test)]
mod tests;
