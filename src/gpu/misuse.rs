//! Our own misuse of the ground floor: one cold function, so that it is found in one place.

/// Ends the program over a bug of ours; what a user can cause never comes here.
#[cold]
#[track_caller]
pub(crate) fn misuse(what: impl std::fmt::Display) -> ! {
    panic!("gpu misuse: {what}; this is a bug in Ashfall, please report it with this line")
}
