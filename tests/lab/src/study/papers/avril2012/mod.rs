//! Q. Avril, V. Gouranton, B. Arnaldi, "Fast collision culling in large-scale environments using GPU
//! mapping function", EGPGV 2012.

mod grid;
mod mapping;
mod outputs;
mod roots;

use super::model::{A_DRAWING, Item, Paper};
use super::records::Figures;

/// The paper's figures.
pub fn paper(figures: &Figures) -> Paper {
    Paper {
        name: "Avril 2012",
        title: "Q. Avril, V. Gouranton, B. Arnaldi: Fast collision culling in large-scale \
                environments using GPU mapping function. EGPGV 2012",
        machine: "Quadro FX 3600M, Core 2 Duo X7900",
        items: vec![
            mapping::table_1(),
            mapping::table_2(figures),
            roots::table_3(figures),
            roots::table_4(figures),
            outputs::table_5(figures),
            grid::table_6(figures),
            grid::table_7(figures),
            grid::figure_1(figures),
            Item::drawing("Figure 2", "the mapping function in the whole", A_DRAWING),
            outputs::figure_3(figures),
            outputs::figure_4(figures),
            grid::figure_5(figures),
            grid::figure_6(figures),
        ],
    }
}
