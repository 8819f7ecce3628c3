//! Table 1 of the paper: frames a second, `GeForce` G105M.

/// A row of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PaperRow {
    /// Spheres.
    pub n: u32,
    /// Frames a second of the sequential approach.
    pub sequential: f64,
    /// Frames a second of the parallel approach.
    pub parallel: f64,
    /// Speed-up.
    pub speed_up: f64,
}

/// The table.
pub const TABLE_1: [PaperRow; 5] = [
    PaperRow { n: 64, sequential: 59.31, parallel: 36.49, speed_up: 0.62 },
    PaperRow { n: 128, sequential: 19.43, parallel: 18.39, speed_up: 0.95 },
    PaperRow { n: 192, sequential: 9.35, parallel: 9.73, speed_up: 1.04 },
    PaperRow { n: 256, sequential: 5.36, parallel: 6.20, speed_up: 1.16 },
    PaperRow { n: 320, sequential: 3.42, parallel: 4.34, speed_up: 1.27 },
];
