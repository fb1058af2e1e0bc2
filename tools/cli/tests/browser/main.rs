//! The console's page in headless Chromium, over a link with delay and losses: `make console-test`.
//!
//! Screenshots go to `target/console-test`, with RENEW=1 to `docs/console`.

mod desk;
mod page;
mod walk;

use std::time::Duration;

use desk::{Desk, Water};
use page::Page;

/// One dive, from the first picture on: one test, since a start of the three programs takes seconds.
#[test]
fn the_page_follows_a_dive() {
    let mut desk = Desk::start();
    let page = Page::open(&desk.page);
    pictures_come_and_change(&page);
    the_page_tells_how_fast_it_is(&page, &desk);
    each_thing_fades_by_its_own_age(&page);
    help_names_what_is_on_the_page(&page);
    the_picture_stands_alone(&page);
    two_pages_know_of_each_other(&page, &desk);
    a_region_is_marked_by_dragging(&page, &mut desk);
    keys_do_what_the_page_says(&page);
    the_overlay_has_patterns(&page);
    silt_makes_it_lost(&page, &desk);
    silence_is_told_and_the_page_recovers(&page, &mut desk);
    it_fits_a_tablet(&page);
    the_overlay_lies_over_the_new_object(&page, &mut desk);
    what_was_told_holds(&page);
    nothing_of_another_run_stays(&page, &mut desk);
    an_alarm_stays_until_it_is_seen(&page);
}

fn pictures_come_and_change(page: &Page) {
    page.until("pictures", "window.latencies.length > 8");
    page.until("the vehicle's time", "state.picture.clock === 'reports'");
    page.until("a path", "state.path && images.plan && images.chase");
    let seen = page.number("checksum(byId('picture'))");
    page.until("another picture", &format!("checksum(byId('picture')) !== {seen}"));
    assert_eq!(page.text("pose-name"), "certain");
    assert_eq!(page.text("pose-label"), "the picture is confirmed");
    assert!(page.text("position").starts_with("± 0."), "{}", page.text("position"));
    assert_eq!(page.number("state.plan.known.length"), 32.0);
    let age = page.number("parseFloat(byId('age').textContent)");
    assert!((0.3..8.0).contains(&age), "{age} s");
    // Ages go on between two states.
    let shown = page.text("age");
    page.until("its age", &format!("byId('age').textContent !== {shown:?}"));
    page.save("certain");
}

fn the_page_tells_how_fast_it_is(page: &Page, desk: &Desk) {
    let (before, cpu) = (page.number("window.latencies.length"), desk.console_cpu());
    let start = std::time::Instant::now();
    page.until("pictures", &format!("window.latencies.length > {before} + 30"));
    let share = (desk.console_cpu() - cpu) / start.elapsed().as_secs_f64();
    let at = |part: f64| {
        let sorted = format!("window.latencies.slice({before}).sort((a, b) => a - b)");
        page.number(&format!("((all) => all[Math.floor(all.length * {part})])({sorted})")) * 1e3
    };
    let (median, most) = (at(0.5), at(0.95));
    println!(
        "modem frame to page: median {median:.0} ms, 95 % {most:.0} ms; console: {:.0} % of a core at {} pictures/s",
        share * 100.0,
        page.text("pictures")
    );
    assert!(median < 2000.0, "{median} ms");
}

/// The limits are those of the link that the desk's vehicle is told.
/// 2 · (2 s + 1/3 s + 0.5 s + 64 bytes at 8 kbit/s), rounded up.
fn each_thing_fades_by_its_own_age(page: &Page) {
    assert_eq!(page.value("state.picture.limits.join()"), "8,20");
    // No state comes in between: what is set stands while one script runs.
    let levels = |set: &str| {
        page.value(&format!(
            "(() => {{
                const before = structuredClone(state);
                state.picture.age = state.chase.age = state.link.silence = 0;
                {set};
                tick();
                const of = (id) => byId(id).closest('[data-age]').dataset.level;
                const found = ['age', 'pose', 'picture', 'plan', 'chase', 'silence', 'loss', 'bytes-plot'].map(of);
                const said = [byId('loss').textContent, byId('position').textContent, byId('pose-name').textContent];
                state = before;
                tick();
                return `${{found.join('')}} ${{said.filter((text) => text === '–' || text.startsWith('was')).length}}`;
            }})()"
        ))
    };
    assert_eq!(levels(""), "00000000 0");
    assert_eq!(levels("state.picture.age = 8.1"), "11110000 0");
    assert_eq!(levels("state.picture.age = 20.1"), "22220000 2");
    assert_eq!(levels("state.chase.age = 20.1"), "00002000 0");
    assert_eq!(levels("state.link.silence = 8.1"), "00000111 0");
    assert_eq!(levels("state.link.silence = 20.1"), "00000222 1");
}

fn help_names_what_is_on_the_page(page: &Page) {
    page.key("?");
    page.until("help", "byId('help').open");
    let unnamed = "[...document.querySelectorAll('header .figure .label, #pose-name, h2')]
        .map((label) => label.firstChild.textContent.split(/[,·]/)[0].trim())
        .filter((name) => !byId('help').textContent.includes(name))";
    assert_eq!(page.value(&format!("({unnamed}).join()")), "");
    page.save("help");
    page.key("Escape");
    page.until("its end", "!byId('help').open");
}

/// Maps are folded, and the picture has all of the screen, with its age and the pose over it.
fn the_picture_stands_alone(page: &Page) {
    let wide = page.number("box.width * box.scale");
    assert!(page.is("/^(0\\.0*)?[125]0* units$/.test(byId('scale').textContent)"));
    assert!(page.is("/^heading [0-9]+°$/.test(byId('heading').textContent)"));
    page.key("m");
    page.until("a wide stage", "byId('stage').clientWidth > innerWidth - 20");
    page.key("m");
    page.key("f");
    page.until("a wide picture", &format!("box.width * box.scale > {wide} * 1.2"));
    let over = "['age-box', 'pose'].every((id) => {
        const [over, stage] = [byId(id), byId('stage')].map((part) => part.getBoundingClientRect());
        return over.width > 0 && over.top >= stage.top && over.bottom < stage.bottom;
    })";
    assert!(page.is(over) && page.is("byId('rate').getBoundingClientRect().width === 0"));
    page.save("full");
    page.key("Escape");
    page.until("all of it", "byId('rate').getBoundingClientRect().width > 0");
}

fn two_pages_know_of_each_other(page: &Page, desk: &Desk) {
    assert_eq!(page.text("pages"), "");
    let view = Page::open(&format!("{}?view", desk.page));
    page.until("the other", "byId('pages').textContent === '2 pages are open'");
    view.until(
        "the other",
        "byId('pages').textContent === 'this page only looks · 2 pages are open'",
    );
    assert_eq!(view.number("byId('record-button').offsetWidth"), 0.0);
    view.key("g");
    view.until("a refusal", "byId('note').textContent.includes('only looks')");
    page.key("g");
    view.until(
        "news",
        "byId('note').textContent.endsWith(' another page: region of interest sent')",
    );
    page.until("a note", "byId('note').textContent.endsWith(' region of interest sent')");
    assert!(!page.text("note").contains("another"));
    page.key("Escape");
    page.until("no region", "state.region === null");
    drop(view);
    page.until("being alone", "byId('pages').textContent === ''");
}

fn a_region_is_marked_by_dragging(page: &Page, desk: &mut Desk) {
    page.drag([0.25, 0.25], [0.75, 0.5]);
    page.until("the region", "state.region && Math.abs(state.region[0] - 0.25) < 0.02");
    desk.vehicle_says("a region of interest");
    page.until("its frame", "state.region[3] > 0.45 && state.region[3] < 0.55");
    page.save("region");
    page.key("ArrowRight");
    page.until("its way right", "state.region && state.region[0] > 0.28");
    page.key("Escape");
    page.until("no region", "state.region === null");
    desk.vehicle_says("no region");
}

fn keys_do_what_the_page_says(page: &Page) {
    for (key, button) in [("o", "overlay-button"), ("p", "path-button")] {
        let pressed = format!("byId('{button}').getAttribute('aria-pressed')");
        for now in ["false", "true"] {
            page.key(key);
            page.until(button, &format!("{pressed} === '{now}'"));
        }
    }
    page.key("s");
    page.until("a snapshot", "/^\\d\\d:\\d\\d:\\d\\d snapshot: /.test(byId('note').textContent)");
    page.key("r");
    page.until("a recording", "state.recorded && state.recorded.frames > 0");
    page.until(
        "its length beside the room on the disk",
        "/^Rec 00:0\\d:\\d\\d, \\d+\\.\\d MB$/.test(byId('record-button').textContent)
            && /^\\d+\\.\\d [MG]B free$/.test(byId('free').textContent)",
    );
    page.key("r");
    page.until("its end", "state.recorded === null");
}

/// Each level is told by a pattern: in grey, too, no two look alike.
fn the_overlay_has_patterns(page: &Page) {
    let kinds = page.number(
        "new Set(LEVELS.filter((level) => level.pattern).map((level) => {
            const canvas = document.createElement('canvas');
            [canvas.width, canvas.height] = [40, 40];
            const ink = canvas.getContext('2d');
            ink.fillStyle = pattern(ink, level);
            ink.fillRect(0, 0, 40, 40);
            const alpha = ink.getImageData(0, 0, 40, 40).data.filter((_, k) => k % 4 === 3);
            return alpha.map((value) => value > 128).join();
        })).size",
    );
    assert_eq!(kinds, 7.0);
    // One colour means one thing.
    assert!(page.is("LEVELS.every(({ colour }) => ![GOOD, DOUBT, BAD].includes(colour))"));
}

/// What a packet has no room to tell, and was told just before, holds (tests of the overlay tell when); with `O`, the
/// legend stays.
fn what_was_told_holds(page: &Page) {
    page.until("an overlay", "state.overlay && state.overlay.levels.length > 0");
    let held = "(() => {
        const levels = state.overlay.levels.map((_, k) => (k % 4 ? 3 : 6 + (k / 4) % 2));
        state.overlay = { ...state.overlay, levels, has_map: false, told_ago: 2.5, seen_before: 9, seen_ago: 4 };
        drawMarks();
        return legend.filter(({ item, words }) =>
            !item.hidden && /^(differs|wrong), told (≥ )?\\d+ s ago \\d+ %$/.test(words.textContent)).length === 2
            && !wasSeen.hidden && /^of memory, \\d+ % was as seen (≥ )?\\d+ s ago/.test(wasSeen.textContent)
            && !byId('legend').hidden;
    })()";
    page.until("what holds", held);
    page.key("o");
    page.until("the same, without patterns", held);
    page.key("o");
}

fn silt_makes_it_lost(page: &Page, desk: &Desk) {
    desk.water(Water::Silt);
    page.until("the search", "state.pose === 'searching'");
    page.until("lost", "state.pose === 'lost' && byId('pose-name').textContent === 'LOST'");
    page.until("the banner", "!byId('banner').hidden");
    page.save("lost");
    page.key("p");
    page.until("why", "byId('note').textContent.includes('No path to draw')");
    page.key("p");
    what_warns_is_seen(page);
    desk.water(Water::Clear);
    page.until("certain again", "state.pose === 'certain'");
}

/// On a small screen, too. The banner lies beside the picture.
fn what_warns_is_seen(page: &Page) {
    for (name, width, height) in [("small", 800, 600), ("large", 2560, 1440), ("middle", 1280, 720)]
    {
        page.resize(width, height);
        let seen = "(() => {
            state.warnings = ['The render is not the vehicle\\'s: do not trust this picture.'];
            showState();
            tick();
            return ['banner', 'warnings', 'note'].every((id) => {
                const place = byId(id).getBoundingClientRect();
                return place.height > 10 && place.bottom <= innerHeight && place.top >= 0;
            }) && byId('banner').getBoundingClientRect().bottom <= byId('stage').getBoundingClientRect().top
                && document.documentElement.scrollHeight <= innerHeight;
        })()";
        page.until(name, seen);
        page.save(name);
    }
}

fn silence_is_told_and_the_page_recovers(page: &Page, desk: &mut Desk) {
    desk.stop_console();
    page.until("the failure", "byId('banner').textContent.includes('does not answer')");
    std::thread::sleep(Duration::from_secs(2));
    assert!(!page.is("byId('banner').hidden"));
    assert_eq!(page.text("pose-name"), "was certain", "what was said long ago is not said of now");
    let faded = "['picture', 'plan', 'chase', 'bytes-plot']
        .every((name) => getComputedStyle(byId(name)).filter.includes('grayscale'))";
    assert!(page.is(faded));
    page.key("s");
    page.until("a note", "byId('note').textContent.includes('nothing was done')");
    page.save("silent");
    let before = page.number("window.latencies.length");
    desk.start_console("prior.ply");
    page.until("the console", "isConnected && byId('banner').hidden");
    page.until("pictures again", &format!("window.latencies.length > {before} + 3"));
    assert!(!page.is(faded));
    assert!(page.text("note").ends_with("the console was started again and goes on"));
    assert_eq!(page.text("pose-name"), "certain");
}

fn it_fits_a_tablet(page: &Page) {
    for (name, width, height) in [("tablet", 1024, 768), ("portrait", 768, 1024)] {
        page.resize(width, height);
        let wide = page.number("document.documentElement.scrollWidth");
        assert!(wide <= f64::from(width), "{name}: {wide} pixels wide");
        let smallest = page.number(
            "Math.min(...[...document.querySelectorAll('button')].map((b) => b.getBoundingClientRect().height))",
        );
        assert!(smallest >= 44.0, "a button of {smallest} pixels is too small for a finger");
        let before = page.number("window.latencies.length");
        page.until("a picture", &format!("window.latencies.length > {before} + 1"));
        page.save(name);
    }
}

/// The frame in which the new box stands in the picture's middle: where it is in blocks of 16 pixels, first and last
/// column and row, and a part of the wall that is as mapped.
const STILL: usize = 12;
const BOX: [u32; 4] = [8, 11, 4, 7];
const WALL: [u32; 4] = [0, 4, 0, 3];

/// At a rate at which packets have no room for it, the page says that it is not shown as it is.
fn the_overlay_lies_over_the_new_object(page: &Page, desk: &mut Desk) {
    page.resize(1280, 720);
    desk.water(Water::Still(STILL));
    desk.restart_vehicle(3000);
    page.value(
        "window.blocks = ([left, right, top, bottom], of) => {
            const found = [];
            for (let y = top; y <= bottom; y++) for (let x = left; x <= right; x++) found.push(of(x, y));
            return found;
        };
        window.level = (x, y) => state.overlay.levels[y * state.overlay.columns + x];
        // The part of a block's pixels that is drawn over.
        window.ink = (x, y) => {
            const [side, canvas] = [16 * box.scale, byId('marks')];
            const context = canvas.getContext('2d', { willReadFrequently: true });
            const block = context.getImageData(box.x + x * side + 1, box.y + y * side + 1, side - 2, side - 2);
            return block.data.filter((alpha, k) => k % 4 === 3 && alpha > 0).length / (block.width * block.height);
        };",
    );
    page.key("p");
    // All in one look, since the next packet may have another map.
    let told = |at: [u32; 4], what: &str| format!("blocks({at:?}, level).every({what})");
    let drawn = |at: [u32; 4], what: &str| format!("blocks({at:?}, ink).every({what})");
    let over_the_box = told(BOX, "(level) => level === 1 || level === 2");
    let as_mapped = told(WALL, "(level) => level === 0");
    let shown =
        "state.overlay && state.picture.complete && loaded.picture === state.picture.number";
    let covered = drawn(BOX, "(part) => part > 0.9");
    let rest = drawn(WALL, "(part) => part === 0");
    let overlay = format!("{shown} && {over_the_box} && {as_mapped} && {covered} && {rest}");
    let mut number = f64::NAN;
    while !page.is(&format!("{overlay} && state.picture.number === {number}")) {
        page.until("the overlay", &overlay);
        number = page.number("state.picture.number");
        page.save("overlay");
    }
    // The legend can be read: patterns beside their words.
    assert!(page.is(
        "legend.every(({ item, words }) => {
            const [swatch, text] = [item.firstChild, words].map((part) => part.getBoundingClientRect());
            return item.hidden || swatch.width >= 30 && swatch.right <= text.left
                && /[a-z] [0-9]+ %$/.test(words.textContent);
        })"
    ));
    page.key("o");
    let bare = drawn(BOX, "(part) => part === 0");
    page.until("a packet with a map, not drawn", &format!("{shown} && {over_the_box} && {bare}"));
    page.key("o");
    page.until("the overlay again", &overlay);
    page.key("p");
}

/// Parts of a canvas's pixels that are drawn.
fn drawn(page: &Page, canvas: &str) -> f64 {
    page.number(&format!(
        "((canvas) => canvas.getContext('2d').getImageData(0, 0, canvas.width, canvas.height).data
            .filter((alpha, k) => k % 4 === 3 && alpha > 0).length / (canvas.width * canvas.height))(byId('{canvas}'))"
    ))
}

/// A console that is started again, with another site's prior, while nothing comes: no picture, no view, no vehicle of
/// before, and the other map.
fn nothing_of_another_run_stays(page: &Page, desk: &mut Desk) {
    page.until("all of it", "images.picture && images.chase && state.plan.vehicle");
    assert!(drawn(page, "picture") > 0.5 && drawn(page, "chase") > 0.1);
    let map = page.number("checksum(byId('plan'))");
    assert!(page.text("prior").starts_with("· prior.ply · "), "{}", page.text("prior"));
    desk.cut_the_link();
    desk.stop_console();
    page.until("the failure", "byId('banner').textContent.includes('does not answer')");
    desk.start_console("other.ply");
    page.until("the other map", "isConnected && state.prior.file === 'other.ply' && images.plan");
    assert!(page.is("state.picture === null && images.picture === null && images.chase === null"));
    for canvas in ["picture", "marks", "chase"] {
        assert_eq!(drawn(page, canvas), 0.0, "{canvas}");
    }
    assert!(page.is("byId('legend').hidden && byId('about').textContent === ''"));
    assert_eq!(
        (page.text("age").as_str(), page.text("pose-name").as_str()),
        ("–", "no picture yet")
    );
    assert_ne!(page.number("checksum(byId('plan'))"), map);
    assert!(page.text("prior").starts_with("· other.ply · "), "{}", page.text("prior"));
    page.save("another-run");
}

/// The other site's console cannot record.
fn an_alarm_stays_until_it_is_seen(page: &Page) {
    page.key("r");
    page.until("an alarm", "byId('alarms').textContent.includes('failed: ')");
    page.key("o");
    page.until("time", &format!("state.now > {} + 1", page.number("state.now")));
    assert_eq!(page.number("byId('alarms').children.length"), 1.0);
    page.key("a");
    page.until("nothing", "state.alarms.length === 1 && byId('alarms').children.length === 0");
}
