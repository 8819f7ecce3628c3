//! Checks whether a file looks like the objects that the command line names. A doubt is a warning,
//! no error.

use pairmask_core::engine::Census;
use pairmask_core::{Aabb, Sphere};

/// Words of a file that are checked, a multiple of both sizes: it takes microseconds.
const LOOKED_AT_WORDS: usize = 12 * 1024;
/// Fewest objects to check: fewer may look like either shape by chance.
const LEAST_OBJECTS: usize = 8;
/// A file looks like a shape if this share of its objects is well formed. Of a file of the other
/// shape, one box in eight is well formed by chance.
const WELL_FORMED: f64 = 0.95;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Look {
    reads_as_boxes: bool,
    reads_as_spheres: bool,
}

impl Look {
    /// Checks the first of `objects`, which are those of a whole file.
    pub fn at<T: bytemuck::Pod>(objects: &[T]) -> Self {
        let words: &[f32] = bytemuck::cast_slice(objects);
        let looked_at = &words[..words.len().min(LOOKED_AT_WORDS)];
        let is_box = |w: &[f32]| (0..3).all(|axis| w[axis] <= w[axis + 3]);
        let is_sphere = |w: &[f32]| w.iter().all(|x| x.is_finite()) && w[3] >= 0.0;
        let reads_as = |size: usize, is_one: &dyn Fn(&[f32]) -> bool| {
            let count = looked_at.len() / size;
            let good = looked_at.chunks_exact(size).filter(|one| is_one(one)).count();
            words.len().is_multiple_of(size)
                && count >= LEAST_OBJECTS
                && good as f64 >= WELL_FORMED * count as f64
        };
        Self {
            reads_as_boxes: reads_as(size_of::<Aabb>() / size_of::<f32>(), &is_box),
            reads_as_spheres: reads_as(size_of::<Sphere>() / size_of::<f32>(), &is_sphere),
        }
    }

    /// What is doubtful of `n` boxes or spheres, so many of which overlap nothing.
    pub fn warning(self, are_boxes: bool, n: u32, useless: &Census) -> Option<String> {
        let Census { empty, invalid, .. } = useless;
        let count = u64::from(*empty) + u64::from(*invalid);
        let (reads_as_other, hint) = if are_boxes {
            (self.reads_as_spheres, "the file reads as spheres: try --shape spheres")
        } else {
            (self.reads_as_boxes, "the file reads as boxes: try it without --shape spheres")
        };
        let [one, other, why_empty, why_invalid] = if are_boxes {
            ["box", "is it a file of boxes?", "min above max", "NaN"]
        } else {
            ["sphere", "is it a file of spheres?", "radius below 0", "no finite centre, or NaN"]
        };
        if n > 0 && count == u64::from(n) {
            let hint = if reads_as_other { hint } else { other };
            return Some(format!(
                "no {one} overlaps anything, since all are empty ({why_empty}: {empty}) or invalid \
                 ({why_invalid}: {invalid}); {hint}"
            ));
        }
        if are_boxes {
            let is_doubtful = 2 * count > u64::from(n) && reads_as_other;
            is_doubtful.then(|| format!("{count} of {n} boxes are empty or invalid, and {hint}"))
        } else {
            reads_as_other.then(|| hint.to_owned())
        }
    }
}

pub fn of_boxes(boxes: &[Aabb]) -> Option<String> {
    Look::at(boxes).warning(true, boxes.len() as u32, &Census::of(boxes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Scene, SceneName};

    fn spheres() -> Vec<Sphere> {
        let boxes = Scene::new(SceneName::Uniform, 300, 1);
        let sphere = |b: &Aabb| Sphere::from([b.min[0], b.min[1], b.min[2], 0.5]);
        boxes.boxes().iter().map(sphere).collect()
    }

    #[test]
    fn every_named_scene_is_a_scene() {
        for name in SceneName::ALL {
            assert_eq!(of_boxes(Scene::new(name, 240, 1).boxes()), None, "{name}");
        }
        assert_eq!(of_boxes(&[]), None);
        assert_eq!(Look::at(&spheres()).warning(false, 300, &Census::default()), None);
    }

    #[test]
    fn half_a_scene_of_empty_slots_is_a_scene() {
        let mut boxes = Scene::new(SceneName::Uniform, 300, 1).boxes().to_vec();
        boxes[..250].fill(Aabb::EMPTY);
        assert_eq!(of_boxes(&boxes), None);
    }
}
