//! A virtual desktop: its pixels, a hand on mouse and keys, and windows that are sized and closed.

use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use x11rb::connection::Connection;
use x11rb::protocol::xproto::{
    AtomEnum, ClientMessageEvent, ConfigureWindowAux, ConnectionExt, EventMask, ImageFormat,
    InputFocus, Window,
};
use x11rb::protocol::xtest::ConnectionExt as _;
use x11rb::rust_connection::RustConnection;

/// Xvfb, which ends with this.
pub struct Desktop {
    server: Child,
    /// As in `DISPLAY`.
    pub display: String,
    connection: RustConnection,
    root: Window,
    size: [u16; 2],
}

/// What a part of the desktop shows: rgb, row by row.
#[derive(Clone, PartialEq)]
pub struct Shot {
    pub size: [u32; 2],
    pub pixels: Vec<[u8; 3]>,
}

impl Desktop {
    pub fn start(size: [u16; 2]) -> Desktop {
        let mut server = Command::new("Xvfb")
            .args(["-displayfd", "1", "-nolisten", "tcp", "-screen", "0"])
            .arg(format!("{}x{}x24", size[0], size[1]))
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb, which tools/setup installs");
        let mut number = String::new();
        let said = server.stdout.take().expect("piped");
        BufReader::new(said).read_line(&mut number).expect("the display's number");
        let display = format!(":{}", number.trim());
        let (connection, screen) = RustConnection::connect(Some(&display)).expect("a connection");
        let root = connection.setup().roots[screen].root;
        Desktop { server, display, connection, root, size }
    }

    pub fn shot(&self) -> Shot {
        let [width, height] = self.size;
        let image = self
            .connection
            .get_image(ImageFormat::Z_PIXMAP, self.root, 0, 0, width, height, u32::MAX)
            .expect("asked")
            .reply()
            .expect("an image");
        let pixels = image.data.chunks_exact(4).map(|bgrx| [bgrx[2], bgrx[1], bgrx[0]]).collect();
        Shot { size: [width.into(), height.into()], pixels }
    }

    /// Waits until the desktop shows something and keeps still for so long.
    pub fn still(&self, still: Duration) -> Shot {
        let begun = Instant::now();
        let (mut last, mut since) = (self.shot(), Instant::now());
        while begun.elapsed() < Duration::from_secs(120) {
            std::thread::sleep(Duration::from_millis(50));
            let now = self.shot();
            if now != last {
                (last, since) = (now, Instant::now());
            }
            if since.elapsed() > still && last.covered() > 100 {
                return last;
            }
        }
        panic!("two minutes, and the desktop does not come to rest");
    }

    fn fake(&self, kind: u8, detail: u8, at: [i16; 2]) {
        let [x, y] = at;
        self.connection
            .xtest_fake_input(kind, detail, x11rb::CURRENT_TIME, self.root, x, y, 0)
            .expect("asked")
            .check()
            .expect("done");
        self.connection.flush().expect("sent");
    }

    pub fn move_to(&self, at: [i16; 2]) {
        self.fake(x11rb::protocol::xproto::MOTION_NOTIFY_EVENT, 0, at);
    }

    /// Presses a button, moves by way of these places, and lets go.
    pub fn drag(&self, button: u8, way: &[[i16; 2]]) {
        self.move_to(way[0]);
        std::thread::sleep(Duration::from_millis(60));
        self.fake(x11rb::protocol::xproto::BUTTON_PRESS_EVENT, button, [0; 2]);
        for at in way {
            std::thread::sleep(Duration::from_millis(40));
            self.move_to(*at);
        }
        std::thread::sleep(Duration::from_millis(60));
        self.fake(x11rb::protocol::xproto::BUTTON_RELEASE_EVENT, button, [0; 2]);
    }

    /// Clicks so many times, quickly.
    pub fn click(&self, button: u8, at: [i16; 2], times: u32) {
        self.move_to(at);
        std::thread::sleep(Duration::from_millis(100));
        for _ in 0..times {
            self.fake(x11rb::protocol::xproto::BUTTON_PRESS_EVENT, button, [0; 2]);
            std::thread::sleep(Duration::from_millis(30));
            self.fake(x11rb::protocol::xproto::BUTTON_RELEASE_EVENT, button, [0; 2]);
            std::thread::sleep(Duration::from_millis(30));
        }
    }

    /// Presses keys one after the other, and lets go of them.
    pub fn keys(&self, keysyms: &[u32]) {
        for keysym in keysyms {
            self.fake(x11rb::protocol::xproto::KEY_PRESS_EVENT, self.code_of(*keysym), [0; 2]);
            std::thread::sleep(Duration::from_millis(60));
        }
        for keysym in keysyms.iter().rev() {
            self.fake(x11rb::protocol::xproto::KEY_RELEASE_EVENT, self.code_of(*keysym), [0; 2]);
        }
    }

    fn code_of(&self, keysym: u32) -> u8 {
        let (least, most) = {
            let setup = self.connection.setup();
            (setup.min_keycode, setup.max_keycode)
        };
        let known = self
            .connection
            .get_keyboard_mapping(least, most - least + 1)
            .expect("asked")
            .reply()
            .expect("keys");
        let per_code = usize::from(known.keysyms_per_keycode);
        let at = known.keysyms.chunks(per_code).position(|of| of.contains(&keysym));
        least + at.expect("a key of it") as u8
    }

    /// The window of this title, once it is there.
    pub fn window(&self, title: &str) -> Window {
        let begun = Instant::now();
        while begun.elapsed() < Duration::from_secs(60) {
            let tree = self.connection.query_tree(self.root).expect("asked").reply().expect("it");
            let found = tree.children.into_iter().find(|window| {
                let name = self
                    .connection
                    .get_property(false, *window, AtomEnum::WM_NAME, AtomEnum::ANY, 0, 256)
                    .ok()
                    .and_then(|name| name.reply().ok());
                name.is_some_and(|name| String::from_utf8_lossy(&name.value).contains(title))
            });
            if let Some(window) = found {
                return window;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        panic!("no window \"{title}\" within a minute");
    }

    pub fn focus(&self, window: Window) {
        self.connection
            .set_input_focus(InputFocus::PARENT, window, x11rb::CURRENT_TIME)
            .expect("asked");
        self.connection.flush().expect("sent");
    }

    /// Moves a window to a place of the desktop.
    pub fn place(&self, window: Window, [x, y]: [i32; 2]) {
        let place = ConfigureWindowAux::new().x(x).y(y);
        self.connection.configure_window(window, &place).expect("asked");
        self.connection.flush().expect("sent");
    }

    pub fn resize(&self, window: Window, [width, height]: [u32; 2]) {
        let size = ConfigureWindowAux::new().width(width).height(height);
        self.connection.configure_window(window, &size).expect("asked");
        self.connection.flush().expect("sent");
    }

    /// Takes the window from the desktop, as minimising does.
    pub fn unmap(&self, window: Window) {
        self.connection.unmap_window(window).expect("asked");
        self.connection.flush().expect("sent");
    }

    pub fn map(&self, window: Window) {
        self.connection.map_window(window).expect("asked");
        self.connection.flush().expect("sent");
    }

    /// As the window's own button does.
    pub fn close(&self, window: Window) {
        let atom = |name: &str| {
            let asked = self.connection.intern_atom(false, name.as_bytes()).expect("asked");
            asked.reply().expect("an atom").atom
        };
        let data = [atom("WM_DELETE_WINDOW"), x11rb::CURRENT_TIME, 0, 0, 0];
        let message = ClientMessageEvent::new(32, window, atom("WM_PROTOCOLS"), data);
        self.connection.send_event(false, window, EventMask::NO_EVENT, message).expect("asked");
        self.connection.flush().expect("sent");
    }
}

impl Drop for Desktop {
    fn drop(&mut self) {
        let _ = self.server.kill();
        let _ = self.server.wait();
    }
}

impl Shot {
    /// A part of it.
    pub fn part(&self, origin: [u32; 2], size: [u32; 2]) -> Shot {
        let row = |y: u32| {
            let first = ((origin[1] + y) * self.size[0] + origin[0]) as usize;
            &self.pixels[first..first + size[0] as usize]
        };
        Shot { size, pixels: (0..size[1]).flat_map(|y| row(y).iter().copied()).collect() }
    }

    /// Pixels that are not black.
    pub fn covered(&self) -> usize {
        self.pixels.iter().filter(|pixel| **pixel != [0; 3]).count()
    }

    /// PSNR against another picture, dB.
    pub fn psnr_db(&self, other: &Shot) -> f64 {
        assert_eq!(self.size, other.size);
        let pairs = self.pixels.as_flattened().iter().zip(other.pixels.as_flattened());
        let square: f64 = pairs.map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
        let mean = square / (3 * self.pixels.len()) as f64;
        10.0 * (255.0 * 255.0 / mean).log10()
    }
}
