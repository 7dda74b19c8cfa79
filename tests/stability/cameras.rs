//! Cameras where rays degenerate.

#[test]
fn cameras_hold() {
    crate::hold("cameras");
}
