//! Placement of names beside points, where there is room.

use super::frame::{AREA, CHAR_WIDTH};

/// A name to place beside its point.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wish<'a> {
    /// The point, in SVG units.
    pub(super) at: [f64; 2],
    /// The name.
    pub(super) text: &'a str,
}

/// The place of a name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) anchor: &'static str,
}

/// An area that no name may cover, in SVG units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Area {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) right: f64,
    pub(super) bottom: f64,
}

/// Half of a point with its edge.
const POINT: f64 = 6.0;
/// Height of a name above its base line, at the font size of phones.
const ASCENT: f64 = 11.0;
const DESCENT: f64 = 3.0;
/// Names are set a little smaller than the text by which [`CHAR_WIDTH`] goes.
const TAG_CHAR_WIDTH: f64 = 0.85 * CHAR_WIDTH;
/// Where a name may stand from its point, best first: sideways, and the base line.
const OFFSETS: [(f64, f64, &str); 12] = [
    (9.0, 4.0, "start"),
    (-9.0, 4.0, "end"),
    (0.0, -10.0, "middle"),
    (0.0, 19.0, "middle"),
    (8.0, -8.0, "start"),
    (8.0, 17.0, "start"),
    (-8.0, -8.0, "end"),
    (-8.0, 17.0, "end"),
    (0.0, -25.0, "middle"),
    (0.0, 34.0, "middle"),
    (0.0, -40.0, "middle"),
    (0.0, 49.0, "middle"),
];

impl Area {
    fn meets(&self, other: &Self) -> bool {
        self.left < other.right
            && other.left < self.right
            && self.top < other.bottom
            && other.top < self.bottom
    }

    /// The area of a point.
    pub(super) fn of_point([x, y]: [f64; 2]) -> Self {
        Self { left: x - POINT, top: y - POINT, right: x + POINT, bottom: y + POINT }
    }

    /// The area of a horizontal or vertical line between two points.
    pub(super) fn of_line([x, y]: [f64; 2], [u, v]: [f64; 2]) -> Self {
        Self {
            left: x.min(u) - 1.0,
            top: y.min(v) - 1.0,
            right: x.max(u) + 1.0,
            bottom: y.max(v) + 1.0,
        }
    }

    /// The area of a name.
    pub(super) fn of_text(place: &Place, text: &str) -> Self {
        let width = TAG_CHAR_WIDTH * text.chars().count() as f64;
        let left = match place.anchor {
            "start" => place.x,
            "end" => place.x - width,
            _ => place.x - width / 2.0,
        };
        Self { left, top: place.y - ASCENT, right: left + width, bottom: place.y + DESCENT }
    }

    fn is_within(&self, outer: &Self) -> bool {
        self.left >= outer.left
            && self.right <= outer.right
            && self.top >= outer.top
            && self.bottom <= outer.bottom
    }
}

/// A place for each name, or `None`: beside its point, off all `points` and the names before it, and
/// off `lines` if possible.
pub(super) fn place(options: &[Wish<'_>], points: &[Area], lines: &[Area]) -> Vec<Option<Place>> {
    let mut taken = points.to_vec();
    let mut places = Vec::new();
    for Wish { at: [x, y], text } in options {
        let free = |avoided: &[Area]| {
            OFFSETS.iter().find_map(|(dx, dy, anchor)| {
                let place = Place { x: x + dx, y: y + dy, anchor };
                let area = Area::of_text(&place, text);
                let is_free = !taken.iter().chain(avoided).any(|other| other.meets(&area));
                (is_free && area.is_within(&AREA)).then_some(place)
            })
        };
        let found = free(lines).or_else(|| free(&[]));
        taken.extend(found.map(|place| Area::of_text(&place, text)));
        places.push(found);
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cover_neither_each_other_nor_points_nor_lines() {
        let at: Vec<[f64; 2]> =
            (0..6).map(|i| [300.0 + 4.0 * f64::from(i), 200.0 + 3.0 * f64::from(i)]).collect();
        let options: Vec<Wish<'_>> =
            at.iter().map(|at| Wish { at: *at, text: "margin=0.1" }).collect();
        let points: Vec<Area> = at.iter().copied().map(Area::of_point).collect();
        let line = Area::of_line([320.0, 100.0], [320.0, 300.0]);
        let places = place(&options, &points, &[line]);
        let areas: Vec<Area> =
            places.iter().flatten().map(|place| Area::of_text(place, "margin=0.1")).collect();
        assert!(areas.len() >= 4, "{places:?}");
        for (i, area) in areas.iter().enumerate() {
            assert!(area.is_within(&AREA), "{area:?}");
            assert!(!points.iter().any(|point| point.meets(area)), "{area:?}");
            assert!(!areas[..i].iter().any(|other| other.meets(area)), "{area:?}");
        }
    }

    #[test]
    fn a_name_without_room_is_left_out() {
        let options = Wish { at: [300.0, 200.0], text: "name" };
        let everywhere = Area { left: 0.0, top: 0.0, right: 1e3, bottom: 1e3 };
        assert_eq!(place(&[options], &[everywhere], &[]), [None]);
        assert!(
            place(&[options], &[], &[everywhere])[0].is_some(),
            "a line is crossed for want of room"
        );
    }

    #[test]
    fn a_name_at_the_right_edge_stands_left_of_its_point() {
        let options = Wish { at: [AREA.right - 2.0, 200.0], text: "spheres" };
        let point = Area::of_point(options.at);
        assert_eq!(place(&[options], &[point], &[])[0].map(|place| place.anchor), Some("end"));
    }
}
