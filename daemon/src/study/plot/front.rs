//! The Pareto front: what nothing beats on both axes.

/// For each point, whether it is on the front: no other point is at most as large on both axes and
/// smaller on one. Equal points are on the front together; a NaN never is.
///
/// ```
/// use pairmaskd::study::plot::pareto_front;
/// let front = pareto_front(&[(1.0, 5.0), (2.0, 2.0), (3.0, 2.0), (4.0, 1.0)]);
/// assert_eq!(front, [true, true, false, true]);
/// ```
pub fn pareto_front(points: &[(f64, f64)]) -> Vec<bool> {
    let beats = |a: (f64, f64), b: (f64, f64)| a.0 <= b.0 && a.1 <= b.1 && a != b;
    points
        .iter()
        .map(|&p| !p.0.is_nan() && !p.1.is_nan() && !points.iter().any(|&other| beats(other, p)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_points_share_the_front_and_nan_is_never_on_it() {
        let points = [(1.0, 1.0), (1.0, 1.0), (1.0, 2.0), (f64::NAN, 0.0), (0.5, 3.0)];
        assert_eq!(pareto_front(&points), [true, true, false, false, true]);
        assert_eq!(pareto_front(&[]), [] as [bool; 0]);
    }
}
