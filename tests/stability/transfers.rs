//! Transfer functions that no step resolves.

#[test]
fn transfers_hold() {
    crate::hold("transfers");
}
