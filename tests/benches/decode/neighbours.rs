//! Pairs by box: for each row with any, the box, the number of its partners, and these. Measured
//! beside the encodings.

use pairmask_core::BoxCount;
use pairmask_core::mask::{MaskView, WordAddress};

/// Groups as words: the number of groups, then box and count of each, then the partners of all.
pub struct Neighbours {
    heads: Vec<[u32; 2]>,
    partners: Vec<u32>,
}

impl Neighbours {
    /// The pairs of a sparse mask, by rows.
    pub fn of(mask: &MaskView<'_>) -> Self {
        let MaskView::Sparse(sparse) = mask else {
            panic!("the rows of a sparse mask are asked for")
        };
        let name = |position: u32| sparse.order().map_or(position, |of| of[position as usize]);
        let (mut heads, mut partners) = (Vec::<[u32; 2]>::new(), Vec::new());
        for word in mask.words() {
            let WordAddress::Sparse { row, block } = word.address else { continue };
            let box_index = name(row);
            if heads.last().is_none_or(|head| head[0] != box_index) {
                heads.push([box_index, 0]);
            }
            let columns = (0..32).filter(|t| word.bits.0 >> t & 1 != 0);
            for column in columns.map(|t| 32 * block + t) {
                partners.push(name(column));
                if let Some(head) = heads.last_mut() {
                    head[1] += 1;
                }
            }
        }
        Self { heads, partners }
    }

    /// The words of a reply.
    pub fn into_words(self) -> Vec<u32> {
        let heads = self.heads.iter().flatten().copied();
        std::iter::once(self.heads.len() as u32).chain(heads).chain(self.partners).collect()
    }

    /// The groups of a reply, to be visited.
    pub fn view(n: BoxCount, words: &[u32]) -> View<'_> {
        let (groups, rest) = words.split_first().expect("the number of groups");
        let (heads, partners) = rest.split_at(2 * *groups as usize);
        View { n: n.get(), heads: heads.as_chunks().0, partners }
    }
}

/// Groups in a reply, checked as they are visited.
pub struct View<'a> {
    n: u32,
    heads: &'a [[u32; 2]],
    partners: &'a [u32],
}

impl View<'_> {
    /// Calls `f` with each box and its partners. Copies them, and drops those that are none, as every
    /// decoder of another process's memory must.
    pub fn for_each_group(&self, mut f: impl FnMut(u32, &[u32])) {
        let mut rest = self.partners;
        let mut buffer = [0; 64];
        for &[name, count] in self.heads {
            let (mut of_box, later) = rest.split_at(rest.len().min(count as usize));
            rest = later;
            while !of_box.is_empty() && name < self.n {
                let (some, more) = of_box.split_at(of_box.len().min(buffer.len()));
                of_box = more;
                let copy = &mut buffer[..some.len()];
                copy.copy_from_slice(some);
                // A sum: a branch on each partner would cost more than the comparisons.
                let strays = copy.iter().map(|b| u32::from(*b >= self.n) + u32::from(*b == name));
                if strays.sum::<u32>() == 0 {
                    f(name, copy);
                }
            }
        }
    }

    /// Calls `f` with each pair, smaller index first.
    pub fn for_each(&self, mut f: impl FnMut(u32, u32)) {
        self.for_each_group(|a, partners| {
            for b in partners {
                f(a.min(*b), a.max(*b));
            }
        });
    }
}
