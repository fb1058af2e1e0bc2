//! `nvsprior key`, and what goes from one side to the other with `--key`.

use std::net::UdpSocket;

use serde_json::json;

use crate::dive::{Dive, FRAMES, INPUT};

const DECODE: &str = "decode --prior prior.ply --packets packets --frames out --overwrite";

/// A dive with the keys `own.key` and `other.key`.
fn dive() -> Dive {
    let dive = Dive::new();
    for name in ["own", "other"] {
        dive.run(&format!("key --out {name}.key")).ends_with(0);
    }
    dive
}

#[test]
fn a_key_is_random_and_for_its_owner_alone() {
    let dive = Dive::without_frames();
    let run = dive.run("key --out a.key").ends_with(0);
    let text = String::from_utf8(dive.bytes("a.key")).unwrap();
    let key = text.lines().find(|line| !line.starts_with('#')).unwrap();
    assert!(key.len() == 64 && key.bytes().all(|digit| digit.is_ascii_hexdigit()), "{text}");
    assert!(!run.stdout.contains(key) && !run.stderr.contains(key));
    let id = run.stdout.split(' ').nth(1).unwrap();
    assert!(id.len() == 8 && text.contains(id), "{}", run.stdout);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let mode = std::fs::metadata(dive.path("a.key")).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
    }
    dive.run("key --out a.key").ends_with(1).says("--out a.key");
    assert_eq!(dive.bytes("a.key"), text.as_bytes());
    dive.run("key --out b.key").ends_with(0);
    assert!(!String::from_utf8(dive.bytes("b.key")).unwrap().contains(key));
}

#[test]
fn packets_of_others_are_named_and_left_out() {
    let dive = dive();
    dive.run(&format!("encode {INPUT} --bytes 300 --packets plain --overwrite")).ends_with(0);
    dive.encode("--bytes 306 --key own.key --epoch 4 --pictures seen");
    for t in 0..FRAMES {
        // The tag counts as a part of the packet, and takes nothing else.
        let keyed = dive.bytes(&format!("packets/{t}.nvsp"));
        assert_eq!(keyed[6..], dive.bytes(&format!("plain/{t}.nvsp")));
    }
    dive.run(&format!("{DECODE} --key own.key --epoch 4")).ends_with(0);
    for t in 0..FRAMES {
        let picture = dive.picture(&format!("out/{t}.png"));
        assert_eq!(picture, dive.picture(&format!("seen/{t}.png")), "frame {t}");
    }
    // One that is there twice, and one without a tag.
    std::fs::copy(dive.path("packets/1.nvsp"), dive.path("packets/7.nvsp")).unwrap();
    std::fs::copy(dive.path("plain/1.nvsp"), dive.path("packets/8.nvsp")).unwrap();
    let run = dive.run(&format!("{DECODE} --key own.key --epoch 4")).ends_with(1);
    assert!(run.stdout.contains("3 of 5 packets decoded"), "{}", run.stdout);
    run.says("packets/7.nvsp: its number was taken before")
        .says("packets/8.nvsp: no key that is held has made its tag");
    assert!(!dive.path("out/7.png").exists() && !dive.path("out/8.png").exists());
    for wrong in ["--key other.key --epoch 4", "--key own.key", "--key own.key --epoch 4 --tag 5"] {
        let run = dive.run(&format!("{DECODE} {wrong}")).ends_with(1);
        assert!(run.stdout.contains("0 of 5 packets decoded"), "{}", run.stdout);
        run.says("--key, --epoch and --tag must be as with `encode`");
    }
    dive.run(DECODE).ends_with(1).says("packets/0.nvsp");
}

#[test]
fn what_is_no_key_file_is_named_and_not_shown() {
    let dive = Dive::without_frames();
    let secret = "5ec1e7".repeat(11);
    std::fs::write(dive.path("bad.key"), format!("# key\n{secret}\n")).unwrap();
    std::fs::write(dive.path("none.key"), "# key\n").unwrap();
    std::fs::write(dive.path("long.key"), vec![b'\n'; 70_000]).unwrap();
    for (file, named) in [
        ("bad.key", "--key bad.key: line 2: a key is 64 hexadecimal digits"),
        ("none.key", "--key none.key: 0 keys"),
        ("long.key", "--key long.key: longer than"),
        ("missing.key", "--key missing.key"),
    ] {
        let run = dive.run(&format!("{DECODE} --key {file}")).ends_with(1).says(named);
        assert!(!run.stderr.contains(&secret), "{}", run.stderr);
    }
}

#[test]
fn a_link_with_a_key_shows_what_one_without_shows() {
    let dive = dive();
    let link = "link --prior prior.ply --cameras cameras.json --threshold 1e-2 --fps 10 --bit-rate 16000 --seconds 2 \
                --return-delay 0.3 --loss 0.1";
    // As much room for pictures: what tags take comes on top, and the link carries it.
    dive.run(&format!("{link} --report plain --overhead 6 --mtu 58")).ends_with(0);
    let run = dive.run(&format!("{link} --report keyed --key own.key")).ends_with(0);
    assert!(run.stdout.contains("6 bytes of number and tag in each modem frame"), "{}", run.stdout);
    let [plain, keyed] = ["plain", "keyed"].map(|name| dive.json(&format!("{name}/link.json")));
    assert_eq!(keyed["shown"], plain["shown"]);
    assert_eq!(keyed["shown_psnr"], plain["shown_psnr"]);
    assert_eq!(plain["bytes"]["tags"], json!(0));
    let [tags, total] = ["tags", "total"].map(|name| keyed["bytes"][name].as_u64().unwrap());
    assert!(tags > 0 && tags.is_multiple_of(6) && tags * 20 > total, "{tags} of {total}");
}

#[test]
fn a_key_needs_room_and_its_arguments_need_a_key() {
    let dive = dive();
    let link = "link --prior prior.ply --cameras cameras.json --report r";
    for (args, named) in [
        ("--epoch 3", "--key"),
        ("--tag 8", "--key"),
        ("--key own.key --tag 1", "between 2 and 16"),
        ("--key own.key --tag 17", "between 2 and 16"),
        ("--key own.key --mtu 21", "MTU of 21 bytes: with these keys it must be 22 or more"),
    ] {
        dive.run(&format!("{link} {args}")).ends_with(2).says(named);
    }
    // Who cannot keep its numbers is told before work begins.
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let vehicle = format!(
        "vehicle --prior prior.ply --cameras cameras.json --to {} --key own.key --epoch",
        socket.local_addr().unwrap()
    );
    dive.run(&format!("{vehicle} 7 --frame-rate 60")).ends_with(0);
    dive.run(&format!("{vehicle} 6")).ends_with(1).says("own.key.vehicle").says("in epoch 7");
    let mut state = std::fs::read(dive.path("own.key.vehicle")).unwrap();
    state[9] ^= 1;
    std::fs::write(dive.path("own.key.vehicle"), state).unwrap();
    dive.run(&format!("{vehicle} 8")).ends_with(1).says("own.key.vehicle").says("damaged");
}
