//! Other formats to stores.
