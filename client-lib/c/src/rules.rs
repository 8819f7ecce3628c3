//! Rules of frames: `pm_rules`.
#![allow(unsafe_code)]

use std::sync::Arc;

use bytemuck::{cast, cast_slice};
use pairmask::filters::{Filter, FilterTable, Rules};

use crate::code::pm_code;
use crate::failure::Failure;
use crate::handles::Handle;
use crate::memory::{In, Out};
use crate::values::{pm_filter, pm_pair, pm_tag};

#[derive(Clone, Copy, Debug, Default)]
#[repr(C)]
pub struct pm_rules {
    pub id: u64,
}

#[derive(Clone, Copy, Default)]
#[repr(C)]
pub struct pm_rules_desc {
    pub struct_size: usize,
    pub tags: In<pm_tag>,
    pub tag_count: usize,
    pub filters: In<pm_filter>,
    pub filter_count: usize,
    pub included: In<pm_pair>,
    pub included_count: usize,
    pub excluded: In<pm_pair>,
    pub excluded_count: usize,
}

growing!(pm_rules_desc);

#[unsafe(no_mangle)]
pub extern "C" fn pm_rules_create(desc: In<pm_rules_desc>, rules: Out<pm_rules>) -> pm_code {
    rules.give(|| {
        let desc = desc.growing()?;
        let mut made = Rules::default();
        made.tags = cast_slice(desc.tags.array(desc.tag_count)?).to_vec();
        made.table = table(desc.filters, desc.filter_count)?;
        for pair in desc.included.array(desc.included_count)? {
            made.lists.include(cast(*pair), true);
        }
        for pair in desc.excluded.array(desc.excluded_count)? {
            made.lists.exclude(cast(*pair), true);
        }
        pm_rules::new(Arc::new(made))
    })
}

/// A table of a program's filters.
pub fn table(filters: In<pm_filter>, count: usize) -> Result<FilterTable, Failure> {
    let filters: Vec<Filter> = filters.array(count)?.iter().map(|f| Filter::from(*f)).collect();
    Ok(FilterTable::new(&filters)?)
}

#[unsafe(no_mangle)]
pub extern "C" fn pm_rules_drop(rules: pm_rules) -> pm_code {
    rules.drop()
}
