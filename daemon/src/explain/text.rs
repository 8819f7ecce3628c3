//! The explanation as text.

use std::fmt;

use super::{
    AxisReport, BoxReport, Explanation, GridReport, PlaceReport, SentReport, Separation, number,
};

impl fmt::Display for Explanation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [i, j] = self.pair;
        if i == j {
            return with_itself(f, self);
        }
        let verdict = if self.overlaps { "IN the mask" } else { "NOT in the mask" };
        writeln!(f, "Pair ({i}, {j}) of {} boxes is {verdict}: {}.", self.boxes, self.reason)?;
        writeln!(f)?;
        for one in &self.box_reports {
            box_line(f, one)?;
        }
        if let Some(axes) = &self.axes {
            writeln!(f)?;
            for axis in axes {
                writeln!(f, "  {}  {}", axis.axis, sentence(axis))?;
            }
        }
        writeln!(f)?;
        if let Some(k) = self.pair_index {
            let (word, bit) = (k / 32, k % 32);
            writeln!(f, "  pair      number {k}: bit {bit} of word {word} of a dense mask")?;
        }
        match &self.sent {
            None => writeln!(f, "  mode      {}: boxes are compared as they are", self.mode)?,
            Some(sent) => sent_lines(f, &self.mode, sent, self.pair)?,
        }
        let edges = self.sent.as_ref().and_then(|sent| sent.cell_edges);
        for (place, index) in self.grid.places.iter().zip(self.pair) {
            place_line(f, &self.grid, place.as_ref(), index, edges)?;
        }
        if self.grid.places.iter().all(Option::is_some) {
            let compared =
                if self.grid.compared { "neighbours: compared" } else { "far apart: not compared" };
            writeln!(f, "  cpu-grid  {compared}")?;
        }
        Ok(())
    }
}

/// The text for one box that was named twice.
fn with_itself(f: &mut fmt::Formatter<'_>, explanation: &Explanation) -> fmt::Result {
    let Explanation { pair: [i, _], boxes, box_reports: [one, _], sent, grid, .. } = explanation;
    writeln!(
        f,
        "Box {i} of {boxes} boxes is no pair with itself: a mask holds pairs of two different boxes."
    )?;
    writeln!(f)?;
    box_line(f, one)?;
    if let Some(sent) = sent {
        sent_line(f, sent, 0, *i)?;
    }
    let edges = sent.as_ref().and_then(|sent| sent.cell_edges);
    place_line(f, grid, grid.places[0].as_ref(), *i, edges)
}

fn box_line(f: &mut fmt::Formatter<'_>, one: &BoxReport) -> fmt::Result {
    let [x, y, z, u, v, w] = &one.coordinates;
    write!(f, "  box {:<6} ({x}, {y}, {z}) to ({u}, {v}, {w})", one.index)?;
    if one.class == "solid" { writeln!(f) } else { writeln!(f, "  {}", one.class) }
}

fn sentence(axis: &AxisReport) -> String {
    let AxisReport { starts, ends, gap_ulps, .. } = axis;
    let steps = ulps(*gap_ulps);
    match axis.state {
        Separation::Touching => format!("touching: both at {starts}"),
        Separation::Apart => {
            format!(
                "apart by {} units ({steps}): one ends at {ends}, the other starts at {starts}",
                axis.gap_text()
            )
        }
        Separation::Overlapping => {
            let depth = axis.gap.map_or_else(|| "∞".to_owned(), |gap| number(-gap));
            format!("overlapping by {depth} units ({steps}), from {starts} to {ends}")
        }
    }
}

fn sent_lines(
    f: &mut fmt::Formatter<'_>,
    mode: &str,
    sent: &SentReport,
    pair: [u32; 2],
) -> fmt::Result {
    writeln!(f, "  mode      {mode}: {}", sent.rule)?;
    for (place, index) in pair.into_iter().enumerate() {
        sent_line(f, sent, place, index)?;
    }
    let Some(axes) = &sent.axes else { return Ok(()) };
    for (k, axis) in axes.iter().enumerate() {
        let gap = axis.gap.map_or(f64::INFINITY, f64::abs);
        let gap = match sent.cell_edges {
            Some(edges) => format!("{} ({} units)", cells(gap), number(gap * edges[k])),
            None => format!("{} units", number(gap)),
        };
        match axis.state {
            Separation::Touching => writeln!(f, "  sent      {}  they meet", axis.axis)?,
            Separation::Apart => writeln!(f, "  sent      {}  apart by {gap}", axis.axis)?,
            Separation::Overlapping => {
                writeln!(f, "  sent      {}  overlapping by {gap}", axis.axis)?;
            }
        }
    }
    Ok(())
}

/// The line of one of the two boxes as it is sent: the box at `place`, of index `index`.
fn sent_line(
    f: &mut fmt::Formatter<'_>,
    sent: &SentReport,
    place: usize,
    index: u32,
) -> fmt::Result {
    let [x, y, z, u, v, w] = &sent.coordinates[place];
    writeln!(f, "  sent      box {index}: {} ({x}, {y}, {z}) to ({u}, {v}, {w})", sent.unit)
}

fn cells(count: f64) -> String {
    if count == 1.0 { "1 cell".to_owned() } else { format!("{} cells", number(count)) }
}

fn ulps(count: i64) -> String {
    match count.unsigned_abs() {
        1 => "1 ulp".to_owned(),
        count => format!("{count} ulps"),
    }
}

/// The line of a box's cells in the grid. `mode_cells` holds the edges of a cell of the mode, the
/// grid's unit in modes of cells.
fn place_line(
    f: &mut fmt::Formatter<'_>,
    grid: &GridReport,
    place: Option<&PlaceReport>,
    index: u32,
    mode_cells: Option<[f64; 3]>,
) -> fmt::Result {
    let Some(place) = place else {
        return writeln!(f, "  cpu-grid  box {index} has no cell: it overlaps nothing");
    };
    let ends = place.first_cell.iter().zip(&place.last_cell);
    let cells: Vec<String> = ends
        .map(
            |(first, last)| {
                if first == last { first.to_string() } else { format!("{first}..{last}") }
            },
        )
        .collect();
    let unit = mode_cells.unwrap_or([1.0; 3]);
    let edges: Vec<String> = place
        .cell_edges
        .iter()
        .zip(unit)
        .map(|(edge, unit)| number(f64::from(*edge) * unit))
        .collect();
    write!(f, "  cpu-grid  box {index}: level {} of {}", place.level, grid.levels)?;
    writeln!(f, ", cells ({}) of about {} units", cells.join(", "), edges.join(" × "))
}
