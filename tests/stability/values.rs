//! Voxels of every kind that files hold.

#[test]
fn values_hold() {
    crate::hold("values");
}
