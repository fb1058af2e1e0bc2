//! The page in Chromium.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use headless_chrome::browser::LaunchOptions;
use headless_chrome::protocol::cdp::{Emulation, Input, Page as Protocol};
use headless_chrome::{Browser, Tab};
use serde_json::{Value, json};

/// How long something may take to show: this machine may have other work.
const PATIENCE: Duration = Duration::from_secs(90);

pub struct Page {
    tab: Arc<Tab>,
    _browser: Browser,
}

impl Page {
    pub fn open(address: &str) -> Page {
        let options = LaunchOptions::default_builder()
            // In a container there is no sandbox.
            .sandbox(false)
            .idle_browser_timeout(Duration::from_secs(600))
            .build()
            .unwrap();
        let browser = Browser::new(options).unwrap();
        let tab = browser.new_tab().unwrap();
        let page = Page { tab, _browser: browser };
        page.resize(1280, 720);
        page.tab.navigate_to(address).unwrap().wait_until_navigated().unwrap();
        page.value(
            "window.checksum = (canvas) => canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height)
                .data.reduce((sum, value) => (sum * 31 + value) % 1000003, 7)",
        );
        page
    }

    pub fn resize(&self, width: u32, height: u32) {
        let size =
            json!({ "width": width, "height": height, "deviceScaleFactor": 1.0, "mobile": false });
        let method: Emulation::SetDeviceMetricsOverride = serde_json::from_value(size).unwrap();
        self.tab.call_method(method).unwrap();
    }

    pub fn value(&self, expression: &str) -> Value {
        let found = self.tab.evaluate(expression, false).unwrap();
        found.value.unwrap_or(Value::Null)
    }

    pub fn number(&self, expression: &str) -> f64 {
        let value = self.value(expression);
        value.as_f64().unwrap_or_else(|| panic!("{expression}: {value}"))
    }

    pub fn is(&self, expression: &str) -> bool {
        self.value(&format!("Boolean({expression})")) == true
    }

    pub fn text(&self, id: &str) -> String {
        self.value(&format!("byId('{id}').textContent")).as_str().unwrap().to_owned()
    }

    /// Waits until an expression is true; before the first state it is not.
    pub fn until(&self, what: &str, expression: &str) {
        let start = Instant::now();
        while !self.is(&format!("state && ({expression})")) {
            if start.elapsed() > PATIENCE {
                self.save("failed");
                panic!("{what} did not come: {}", self.value("JSON.stringify(state)"));
            }
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    pub fn key(&self, key: &str) {
        self.tab.press_key(key).unwrap();
    }

    /// Drags from one place of the picture to another; parts of its sides.
    pub fn drag(&self, from: [f64; 2], to: [f64; 2]) {
        let pixel = |at: f64, part: &str, side: &str| {
            let edge = if part == "x" { "left" } else { "top" };
            self.number(&format!(
                "byId('marks').getBoundingClientRect().{edge} + box.{part} + {at} * box.{side} * box.scale"
            ))
        };
        let place = |[x, y]: [f64; 2]| [pixel(x, "x", "width"), pixel(y, "y", "height")];
        let (from, to) = (place(from), place(to));
        self.mouse("mousePressed", from);
        self.mouse("mouseMoved", [(from[0] + to[0]) / 2.0, to[1]]);
        self.mouse("mouseMoved", to);
        self.mouse("mouseReleased", to);
    }

    fn mouse(&self, kind: &str, [x, y]: [f64; 2]) {
        let event = json!({ "type": kind, "x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1 });
        let method: Input::DispatchMouseEvent = serde_json::from_value(event).unwrap();
        self.tab.call_method(method).unwrap();
    }

    /// Keeps what is seen.
    pub fn save(&self, name: &str) {
        let format = Protocol::CaptureScreenshotFormatOption::Jpeg;
        let seen = self.tab.capture_screenshot(format, Some(70), None, true).unwrap();
        let root = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../..");
        let [documents, folder] = ["docs/console", "target/console-test"].map(|at| root.join(at));
        let file = format!("{name}.jpg");
        let renew = std::env::var_os("RENEW").is_some() && documents.join(&file).exists();
        let folder = if renew { documents } else { folder };
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join(file), seen).unwrap();
    }
}
