//! Fields with closed forms, and fields as rough as voxels allow.

#[test]
fn fields_hold() {
    crate::hold("fields");
}
