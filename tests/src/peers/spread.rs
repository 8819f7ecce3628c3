//! Times of many frames in four numbers.

/// Median and spread of frame times, ns. On a shared machine the least is the steadiest number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Spread {
    /// The fastest frame.
    pub least_ns: u64,
    /// A tenth of the frames was faster.
    pub p10_ns: u64,
    /// Half of the frames was faster.
    pub median_ns: u64,
    /// A tenth of the frames was slower.
    pub p90_ns: u64,
}

impl Spread {
    /// The spread of these times, zeros where there is none.
    pub fn of(times_ns: &[u64]) -> Self {
        let mut sorted = times_ns.to_vec();
        sorted.sort_unstable();
        let at = |tenths: usize| {
            let last = sorted.len().saturating_sub(1);
            sorted.get((last * tenths + 5) / 10).copied().unwrap_or(0)
        };
        Self { least_ns: at(0), p10_ns: at(1), median_ns: at(5), p90_ns: at(9) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spread_is_that_of_the_numbers() {
        assert_eq!(Spread::of(&[]), Spread::default());
        assert_eq!(Spread::of(&[7]), Spread { least_ns: 7, p10_ns: 7, median_ns: 7, p90_ns: 7 });
        let times: Vec<u64> = (0..=100).rev().collect();
        assert_eq!(
            Spread::of(&times),
            Spread { least_ns: 0, p10_ns: 10, median_ns: 50, p90_ns: 90 }
        );
    }
}
