//! The constants of the cost model: what each engine takes on one machine.

use crate::engine::Isa;

/// Cost of the sweep's and the brute-force engine's stages, one thread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairwiseCost {
    /// A frame of no boxes, ns.
    pub fixed_ns: f64,
    /// Each box (read, sorted, put in order), ns.
    pub ns_a_box: f64,
    /// Each pair that is compared, ns.
    pub ns_a_test: f64,
    /// More for each pair found: brute force rules most columns out by bitmaps, and those that are
    /// left, which grow with the pairs, are compared. ns.
    pub ns_a_pair: f64,
    /// Most that all of this comes to for each pair that is compared: nothing was ruled out. ns.
    pub ns_a_test_most: f64,
}

/// Cost of the grid, one thread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridCost {
    /// A frame of no boxes, ns.
    pub fixed_ns: f64,
    /// More for choosing levels where sizes differ, ns.
    pub levels_ns: f64,
    /// Each box, ns.
    pub ns_a_box: f64,
    /// More for each box and doubling of the large sizes over the median, ns.
    pub ns_a_size_doubling: f64,
    /// More for each box and unit of elongation (longest edge / shortest edge) above 2, ns.
    pub ns_a_elongation: f64,
}

/// What this machine takes for what. Built-in figures are the default; `pairmaskd calibrate`
/// measures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Calibration {
    /// `cpu-brute`.
    pub brute: PairwiseCost,
    /// `cpu-sap`.
    pub sap: PairwiseCost,
    /// `cpu-grid`.
    pub grid: GridCost,
    /// Each pair found, in the sparse encoding: kept, published, ns.
    pub ns_a_sparse_pair: f64,
    /// Each pair found, in the dense encoding of an engine that has another order than the
    /// boxes', ns.
    pub ns_a_scattered_pair: f64,
    /// Each byte of a dense mask, written and later scanned by the client, ns.
    pub ns_a_dense_byte: f64,
    /// Share of an engine's work that a second and each further thread takes over.
    pub thread_gain: f64,
    /// Handing work to other threads and waiting for them, ns a frame.
    pub thread_fixed_ns: f64,
}

impl Calibration {
    /// Figures for an instruction set: measured with `cargo bench -p pairmask-tests --bench
    /// engines` on one core of an AMD EPYC 9004 at 2.6 GHz (AVX-512), least of 11 frames. The
    /// narrower sets are scaled by their lanes.
    pub fn built_in(isa: Isa) -> Self {
        let lanes = match isa {
            Isa::Avx512 => 1.0,
            Isa::Avx2 => 1.6,
            Isa::Neon => 3.0,
            Isa::Portable => 6.0,
        };
        Self {
            brute: PairwiseCost {
                fixed_ns: 400.0,
                ns_a_box: 18.0,
                ns_a_test: 0.0205 * lanes,
                ns_a_pair: 8.0,
                ns_a_test_most: 0.35 * lanes,
            },
            sap: PairwiseCost {
                fixed_ns: 300.0,
                ns_a_box: 22.0,
                ns_a_test: 0.46 * lanes,
                ns_a_pair: 0.0,
                ns_a_test_most: 0.46 * lanes,
            },
            grid: GridCost {
                fixed_ns: 7_000.0,
                levels_ns: 20_000.0,
                ns_a_box: 28.0 + 14.0 * lanes,
                ns_a_size_doubling: 4.0 * lanes,
                ns_a_elongation: 1.5 * lanes,
            },
            ns_a_sparse_pair: 3.0,
            ns_a_scattered_pair: 8.0,
            ns_a_dense_byte: 0.15,
            thread_gain: 0.8,
            thread_fixed_ns: 8_000.0,
        }
    }
}
