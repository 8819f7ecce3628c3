//! The explanation for people.

use std::fmt;

use super::gap::number;
use super::{AxisReport, BoxReport, Explanation, GridReport, Separation};

impl fmt::Display for Explanation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [i, j] = self.pair;
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
        writeln!(f, "  mode      {}: boxes are compared as they are", self.mode)?;
        grid_lines(f, &self.grid, self.pair)
    }
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
                "apart by {} ({steps}): one ends at {ends}, the other starts at {starts}",
                axis.gap_text()
            )
        }
        Separation::Overlapping => {
            let depth = axis.gap.map_or_else(|| "∞".to_owned(), |gap| number(-gap));
            format!("overlapping by {depth} ({steps}), from {starts} to {ends}")
        }
    }
}

fn ulps(count: i64) -> String {
    match count.unsigned_abs() {
        1 => "1 ulp".to_owned(),
        count => format!("{count} ulps"),
    }
}

fn grid_lines(f: &mut fmt::Formatter<'_>, grid: &GridReport, pair: [u32; 2]) -> fmt::Result {
    for (place, index) in grid.places.iter().zip(pair) {
        let Some(place) = place else {
            writeln!(f, "  cpu-grid  box {index} has no cell: it overlaps nothing")?;
            continue;
        };
        let cells: Vec<String> = place
            .first_cell
            .iter()
            .zip(&place.last_cell)
            .map(
                |(first, last)| {
                    if first == last { first.to_string() } else { format!("{first}..{last}") }
                },
            )
            .collect();
        let edges = place.cell_edges.map(|edge| number(f64::from(edge)));
        write!(f, "  cpu-grid  box {index}: level {} of {}", place.level, grid.levels)?;
        writeln!(f, ", cells ({}) of about {}", cells.join(", "), edges.join(" × "))?;
    }
    if grid.places.iter().all(Option::is_some) {
        let compared =
            if grid.compared { "neighbours: compared" } else { "far apart: not compared" };
        writeln!(f, "  cpu-grid  {compared}")?;
    }
    Ok(())
}
