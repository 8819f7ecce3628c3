//! The papers' measurements, for comparison. All boxes moving, whole frame, ns.

/// A paper's line: name, then (boxes, ns).
pub(super) struct PaperLine {
    pub(super) name: &'static str,
    pub(super) points: &'static [(f64, f64)],
}

/// Avril et al. 2012, table 6 (Quadro FX 3600M); Liu et al. 2010 (Tesla C1060, 64K to 256K).
pub(super) const LINES: [PaperLine; 2] = [
    PaperLine {
        name: "Avril 2012, GPU grid",
        points: &[(1e3, 0.25e6), (1e4, 2.35e6), (1e5, 27.9e6), (1e6, 292e6)],
    },
    PaperLine {
        name: "Liu 2010, GPU sweep",
        points: &[(65_536.0, 13.7e6), (131_072.0, 48e6), (262_144.0, 241e6)],
    },
];
