//! The filters of other engines, written as [`Filter`](super::Filter)s and [`Tag`](super::Tag)s.
