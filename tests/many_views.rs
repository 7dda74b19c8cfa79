//! Many pictures of one scene at once: two eyes, the screens of a wall, the frames of a path.

#[path = "many_views/path.rs"]
mod path;
#[path = "many_views/scene.rs"]
mod scene;
#[path = "many_views/stereo.rs"]
mod stereo;
#[path = "many_views/wall.rs"]
mod wall;

mod binary;
mod common;
mod folder;
