//! The Pareto front: the points that no other point beats on all axes.

/// For each point, whether it is on the front: no other point is at most as large on every axis and
/// smaller on one. Equal points are on the front together; a NaN never is.
///
/// ```
/// use pairmaskd::plot::pareto_front;
/// let front = pareto_front(&[[1.0, 5.0], [2.0, 2.0], [3.0, 2.0], [4.0, 1.0]]);
/// assert_eq!(front, [true, true, false, true]);
/// ```
pub fn pareto_front<const AXES: usize>(points: &[[f64; AXES]]) -> Vec<bool> {
    let beats = |a: &[f64; AXES], b: &[f64; AXES]| a != b && a.iter().zip(b).all(|(a, b)| a <= b);
    let is_beaten = |p: &[f64; AXES]| points.iter().any(|other| beats(other, p));
    points.iter().map(|p| !p.iter().any(|x| x.is_nan()) && !is_beaten(p)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_points_share_the_front_and_nan_is_never_on_it() {
        let points = [[1.0, 1.0], [1.0, 1.0], [1.0, 2.0], [f64::NAN, 0.0], [0.5, 3.0]];
        assert_eq!(pareto_front(&points), [true, true, false, false, true]);
        assert_eq!(pareto_front::<2>(&[]), [] as [bool; 0]);
    }

    #[test]
    fn a_third_axis_saves_what_two_would_beat() {
        let points = [[1.0, 1.0, 9.0], [2.0, 2.0, 8.0], [3.0, 3.0, 8.0]];
        assert_eq!(pareto_front(&points), [true, true, false]);
    }
}
