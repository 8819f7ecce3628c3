//! The smallest form of each scene, and what the link would gain by it.

use serde::Serialize;

use super::form::Form;
use super::measure::FormRow;

/// What a GPU writes across its link, bytes a ns: 52 GB/s, measured with a kernel of an H200 on
/// imported memory. On a slower link every byte that is saved counts for more.
const LINK_DOWN_BYTES_A_NS: f64 = 52.0;

/// Whether a reply has to carry the order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum OrderState {
    /// It changed, as in every frame today.
    Sent,
    /// It did not change, and the client kept it.
    Kept,
}

impl OrderState {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Sent, Self::Kept];

    /// The name in reports.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Sent => "sent",
            Self::Kept => "kept",
        }
    }

    /// Bytes that cross the link.
    const fn bytes(self, row: &FormRow) -> u64 {
        match self {
            Self::Sent => row.bytes,
            Self::Kept => row.bytes - row.order_bytes,
        }
    }
}

/// The smallest form of a scene in the largest size that was measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SmallestRow {
    /// Which scene.
    pub scene: &'static str,
    /// Boxes.
    pub n: usize,
    /// Whether the reply carries the order.
    pub order: OrderState,
    /// Which form has the fewest bytes; the one nearer to the wire's among equals.
    pub form: &'static str,
    /// Its bytes.
    pub bytes: u64,
    /// Bytes of the reply as it is: sparse, with the order.
    pub sparse_bytes: u64,
    /// What the link would save against the reply as it is, µs at 52 GB/s.
    pub link_saved_us: f64,
    /// What decoding on one thread takes more than the sparse form, both with the study's decoders,
    /// µs. Less than 0 where it takes less.
    pub decode_more_us: f64,
}

/// The smallest forms, by scene in the order of the rows.
pub fn smallest(rows: &[FormRow]) -> Vec<SmallestRow> {
    let mut scenes: Vec<&'static str> = Vec::new();
    for row in rows {
        if !scenes.contains(&row.scene) {
            scenes.push(row.scene);
        }
    }
    let of_scene = |scene: &&'static str| {
        let n = rows.iter().filter(|row| row.scene == *scene).map(|row| row.n).max();
        let of_size: Vec<_> =
            rows.iter().filter(|row| row.scene == *scene && Some(row.n) == n).collect();
        OrderState::ALL.map(|order| of_order(&of_size, order))
    };
    scenes.iter().flat_map(of_scene).flatten().collect()
}

/// The smallest of the forms of one mask. `None` where the sparse form is not among them.
fn of_order(forms: &[&FormRow], order: OrderState) -> Option<SmallestRow> {
    let sparse = forms.iter().find(|row| row.form == Form::Sparse.as_str())?;
    let least = forms.iter().min_by_key(|row| order.bytes(row))?;
    let bytes = order.bytes(least);
    let ns = |row: &FormRow| row.decode_ns as f64;
    Some(SmallestRow {
        scene: least.scene,
        n: least.n,
        order,
        form: least.form,
        bytes,
        sparse_bytes: sparse.bytes,
        link_saved_us: (sparse.bytes as f64 - bytes as f64) / LINK_DOWN_BYTES_A_NS / 1e3,
        decode_more_us: (ns(least) - ns(sparse)) / 1e3,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(scene: &'static str, n: usize, form: Form, bytes: u64, order_bytes: u64) -> FormRow {
        FormRow {
            scene,
            n,
            pairs: 1,
            form: form.as_str(),
            entries: 1,
            bytes,
            order_bytes,
            bytes_a_pair: None,
            order_kept_bytes_a_pair: None,
            decode_ns: 1_000 * bytes,
            production_decode_ns: 1,
            decode_ratio: 1.0,
        }
    }

    #[test]
    fn the_fewest_bytes_of_the_largest_size_win() {
        let rows = [
            row("pile", 9, Form::Sparse, 520_000, 52_000),
            row("pile", 9, Form::Packed, 468_000, 52_000),
            row("pile", 9, Form::List, 442_000, 0),
            row("pile", 5, Form::List, 1, 0),
            row("uniform", 5, Form::Sparse, 10, 0),
            row("uniform", 5, Form::Packed, 10, 0),
        ];
        let found = smallest(&rows);
        let names: Vec<_> = found.iter().map(|row| (row.scene, row.order, row.form)).collect();
        let (sent, kept) = (OrderState::Sent, OrderState::Kept);
        assert_eq!(
            names,
            [
                ("pile", sent, "list"),
                ("pile", kept, "packed"),
                ("uniform", sent, "sparse"),
                ("uniform", kept, "sparse"),
            ]
        );
        assert_eq!((found[0].link_saved_us, found[1].link_saved_us), (1.5, 2.0));
        assert_eq!((found[1].bytes, found[1].sparse_bytes), (416_000, 520_000));
        assert_eq!(found[1].decode_more_us, -52_000.0);
        assert_eq!(smallest(&rows[1..3]), []);
    }
}
