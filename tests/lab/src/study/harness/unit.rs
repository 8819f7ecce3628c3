//! Numbers as text for readers.

/// The unit of the numbers on an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// Time, ns.
    Nanoseconds,
    /// Memory, bytes.
    Bytes,
    /// Things.
    Count,
    /// A ratio, as it is.
    Ratio,
}

impl Unit {
    /// Three significant digits with the unit that leaves the fewest digits.
    pub fn text(self, value: f64) -> String {
        let steps: &[(f64, &str)] = match self {
            Self::Nanoseconds => &[(1e9, " s"), (1e6, " ms"), (1e3, " µs"), (1.0, " ns")],
            Self::Bytes => &[(1e9, " GB"), (1e6, " MB"), (1e3, " KB"), (1.0, " B")],
            Self::Count => &[(1e9, "G"), (1e6, "M"), (1e3, "K"), (1.0, "")],
            Self::Ratio => &[(1.0, "")],
        };
        let size = value.abs();
        let (step, name) =
            steps.iter().find(|(step, _)| size >= *step).or(steps.last()).unwrap_or(&(1.0, ""));
        format!("{}{name}", three_digits(value / step))
    }
}

/// Three significant digits; powers of ten where the number is too small to be read otherwise.
fn three_digits(value: f64) -> String {
    let size = value.abs();
    if size == 0.0 {
        return "0".to_owned();
    }
    if size < 1e-3 {
        let text = format!("{value:.2e}");
        return text.replace(".00e", "e");
    }
    let decimals = if size >= 100.0 {
        0
    } else if size >= 10.0 {
        1
    } else if size >= 1.0 {
        2
    } else if size >= 0.1 {
        3
    } else {
        5
    };
    let text = format!("{value:.decimals$}");
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_as_people_write_them() {
        for (unit, value, text) in [
            (Unit::Nanoseconds, 0.0, "0 ns"),
            (Unit::Nanoseconds, 12.34, "12.3 ns"),
            (Unit::Nanoseconds, 1_000.0, "1 µs"),
            (Unit::Nanoseconds, 28_540_000.0, "28.5 ms"),
            (Unit::Count, 1_000_000.0, "1M"),
            (Unit::Count, 4_096.0, "4.1K"),
            (Unit::Bytes, 24_000_000.0, "24 MB"),
            (Unit::Ratio, 0.01, "0.01"),
            (Unit::Ratio, 1e-4, "1e-4"),
            (Unit::Ratio, 120.0, "120"),
        ] {
            assert_eq!(unit.text(value), text);
        }
    }
}
