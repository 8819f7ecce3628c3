//! Rules of frames: `pm_rules`.
#![allow(unsafe_code)]

use std::ptr::null;
use std::sync::Arc;

use pairmask::filters::{Filter, FilterTable, Rules};

use crate::call::call;
use crate::code::pm_code;
use crate::failure::Failure;
use crate::handles::handle;
use crate::memory::{Growing, array, check_out, growing, write};
use crate::values::{pairs, pm_filter, pm_pair, pm_tag, tags};

/// Which boxes of a frame may be a pair at all. It does not change: a daemon gets it once, however many frames
/// have it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(C)]
pub struct pm_rules {
    /// Zero for none.
    pub id: u64,
}

handle!(pm_rules is Arc<Rules>);

/// What rules are made of. They decide in this order: boxes of different worlds never meet; an included pair is
/// reported where it overlaps; boxes of one owner never meet; two static ones never; an excluded pair never; then
/// filters decide. All arrays are copied.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct pm_rules_desc {
    /// `sizeof(pm_rules_desc)`.
    pub struct_size: usize,
    /// Tags by index. An index beyond them has a tag of zeros.
    pub tags: *const pm_tag,
    /// How many.
    pub tag_count: usize,
    /// The filters that tags name. One beyond them meets everything.
    pub filters: *const pm_filter,
    /// How many; at most 65,536.
    pub filter_count: usize,
    /// Pairs that are reported, whatever else keeps them apart but worlds.
    pub included: *const pm_pair,
    /// How many.
    pub included_count: usize,
    /// Pairs that are never reported.
    pub excluded: *const pm_pair,
    /// How many.
    pub excluded_count: usize,
}

// SAFETY: it is `repr(C)` and begins with its size; pointers and integers have no invalid bit patterns.
unsafe impl Growing for pm_rules_desc {}

/// Makes rules.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn pm_rules_create(
    desc: *const pm_rules_desc,
    rules: *mut pm_rules,
) -> pm_code {
    call(|| {
        check_out(rules)?;
        let nothing = pm_rules_desc {
            struct_size: size_of::<pm_rules_desc>(),
            tags: null(),
            tag_count: 0,
            filters: null(),
            filter_count: 0,
            included: null(),
            included_count: 0,
            excluded: null(),
            excluded_count: 0,
        };
        let mut made = Rules::default();
        // SAFETY: the caller's promise about pointers is passed on.
        unsafe {
            let desc = growing(desc, nothing)?;
            made.tags = tags(array(desc.tags, desc.tag_count)?).to_vec();
            made.table = table(array(desc.filters, desc.filter_count)?)?;
            for pair in pairs(array(desc.included, desc.included_count)?) {
                made.lists.include(*pair, true);
            }
            for pair in pairs(array(desc.excluded, desc.excluded_count)?) {
                made.lists.exclude(*pair, true);
            }
            write(rules, pm_rules::new(Arc::new(made))?)
        }
    })
}

/// A table of a program's filters.
pub fn table(filters: &[pm_filter]) -> Result<FilterTable, Failure> {
    let filters: Vec<Filter> = filters.iter().map(|filter| Filter::from(*filter)).collect();
    Ok(FilterTable::new(&filters)?)
}

/// Drops rules. Frames that were submitted with them keep them.
#[unsafe(no_mangle)]
pub extern "C" fn pm_rules_drop(rules: pm_rules) -> pm_code {
    rules.drop()
}
