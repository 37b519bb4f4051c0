//! Kills coordinators and workers at every important place, and checks that a second run ends like
//! an uninterrupted one: nothing lost, nothing published twice, no finished task started again.

mod book;
#[path = "../built.rs"]
mod built;
mod scene;

use rustix::process::Signal;

use book::Book;
use scene::{Scene, worker};

/// Lets a small run die at each of its crash points in turn, until a run reaches its end.
fn die_at_every_point(executor: &str, patients: usize, sleep_ms: u64) {
    let peaceful = Scene::new(patients, sleep_ms, executor);
    peaceful.finish();
    let expected = Book::read(&peaceful);
    expected.assert_sound();
    let mut died = 0;
    for point in 1.. {
        let scene = Scene::new(patients, sleep_ms, executor);
        let first = scene.run_until_crash_point(point);
        if first.died {
            died += 1;
            scene.finish();
        }
        let book = Book::read(&scene);
        book.assert_sound();
        assert_eq!(
            book.end_state(),
            expected.end_state(),
            "after a crash at point {point}: {}",
            first.last_words
        );
        if executor != "in-process" {
            // No worker was killed, so every task was worked on exactly once, whichever coordinator
            // saw it end.
            assert_eq!(
                scene.claims(),
                patients * 3,
                "after a crash at point {point}: {}",
                first.last_words
            );
        }
        if !first.died {
            break;
        }
    }
    assert!(
        died > 10,
        "only {died} crash points were passed: is the hook still there?"
    );
}

#[test]
fn a_coordinator_killed_at_any_point_is_continued_in_process() {
    die_at_every_point("in-process", 2, 0);
}

#[test]
fn a_coordinator_killed_at_any_point_is_continued_with_workers() {
    die_at_every_point(&worker(), 2, 20);
}

/// A run that an earlier version left half done is converted by the next one, which dies at each of its first points.
#[test]
fn a_coordinator_killed_while_it_converts_an_older_run_is_continued() {
    let mut places = Vec::new();
    for point in 1.. {
        let scene = Scene::new(2, 0, "in-process");
        assert!(scene.run_until_crash_point(14).died, "the run was over");
        scene.make_older();
        let second = scene.run_until_crash_point(point);
        let book = Book::read(&scene);
        scene.finish();
        Book::read(&scene).assert_sound();
        assert_eq!(
            book.end_state().0.len(),
            2,
            "readers see the patients after {}",
            second.last_words
        );
        if !second.last_words.contains("conversion") && !second.last_words.contains("older") {
            break;
        }
        places.push(second.last_words);
    }
    assert_eq!(
        places.len(),
        3,
        "one for the copy and two around the conversion: {places:?}"
    );
}

#[test]
fn a_coordinator_killed_twice_at_any_point_is_continued() {
    let worker = worker();
    for point in 1.. {
        let scene = Scene::new(2, 5, &worker);
        let first = scene.run_until_crash_point(point);
        for again in 2..4 {
            scene.run_until_crash_point(point / again + 1);
        }
        scene.finish();
        Book::read(&scene).assert_sound();
        assert_eq!(
            scene.claims(),
            6,
            "after three crashes around point {point}"
        );
        if !first.died {
            break;
        }
    }
}

#[test]
fn a_killed_worker_is_tried_again_in_another_directory() {
    let scene = Scene::new(1, 0, &worker());
    scene.hold();
    let coordinator = scene.start();
    let claim = scene.wait_for_claim(&[]);
    scene::kill(claim.pid, Signal::KILL);
    scene.release();
    let said = coordinator.end();
    assert!(said.ok, "{}", said.stderr);
    assert!(
        said.stderr.contains("killed by signal 9"),
        "{}",
        said.stderr
    );
    let book = Book::read(&scene);
    book.assert_sound();
    assert_eq!(scene.claims(), 4, "three tasks, one of them twice");
    assert_eq!(book.generations(), [1, 1, 2]);
}

#[test]
fn a_worker_that_is_killed_each_time_fails_its_patient_for_the_sites_sake() {
    let scene = Scene::new(1, 0, &worker());
    scene.hold();
    let coordinator = scene.start();
    let mut killed = Vec::new();
    for _ in 0..3 {
        let claim = scene.wait_for_claim(&killed);
        scene::kill(claim.pid, Signal::KILL);
        killed.push(claim.pid);
    }
    let said = coordinator.end();
    assert!(
        said.stdout.contains(r#""failed":1"#),
        "{}\n{}",
        said.stdout,
        said.stderr
    );
    assert_eq!(scene.claims(), 3, "the first try and two more");
}

#[test]
fn a_worker_that_outlives_its_coordinator_is_adopted_and_publishes() {
    let scene = Scene::new(1, 0, &worker());
    scene.hold();
    let coordinator = scene.start();
    let claim = scene.wait_for_claim(&[]);
    coordinator.kill();
    assert!(
        scene::lives(claim.pid),
        "the worker must outlive its coordinator"
    );
    let mut second = scene.start();
    second.wait_for_words("adopted: 1");
    scene.release();
    scene.finish_with(second);
    let book = Book::read(&scene);
    book.assert_sound();
    assert_eq!((scene.claims(), book.generations()), (3, vec![1, 1, 1]));
}

#[test]
fn a_worker_that_died_with_its_coordinator_is_tried_again_free_of_charge() {
    let scene = Scene::new(1, 0, &worker());
    scene.hold();
    let mut killed = Vec::new();
    // More often than site failures are forgiven.
    for _ in 0..4 {
        let coordinator = scene.start();
        let claim = scene.wait_for_claim(&killed);
        coordinator.kill();
        scene::kill(claim.pid, Signal::KILL);
        killed.push(claim.pid);
    }
    scene.release();
    scene.finish();
    let book = Book::read(&scene);
    book.assert_sound();
    assert_eq!(book.generations(), [1, 1, 5]);
}

#[test]
fn one_interrupt_finishes_what_is_short_and_two_stop_at_once() {
    for (interrupts, claims) in [(1, 3), (2, 4)] {
        let scene = Scene::new(1, 0, &worker());
        scene.hold();
        let mut coordinator = scene.start();
        scene.wait_for_claim(&[]);
        coordinator.signal(Signal::INT);
        // Signals in quick succession may be merged into one.
        coordinator.wait_for_words("draining: true");
        match interrupts {
            1 => scene.release(),
            _ => coordinator.signal(Signal::INT),
        }
        let said = coordinator.end();
        assert!(
            said.ok && said.stdout.contains(r#""unfinished":1"#),
            "{}\n{}",
            said.stdout,
            said.stderr
        );
        assert!(
            said.stdout
                .contains(&format!(r#""published":{}"#, 2 - interrupts)),
            "{}",
            said.stdout
        );
        if interrupts == 2 {
            scene.release();
        }
        scene.finish();
        let book = Book::read(&scene);
        book.assert_sound();
        assert_eq!(scene.claims(), claims, "{interrupts} interrupts");
    }
}

#[test]
fn a_second_coordinator_is_told_who_works_there() {
    let scene = Scene::new(1, 0, &worker());
    scene.hold();
    let coordinator = scene.start();
    scene.wait_for_claim(&[]);
    let second = scene.start().end();
    assert!(
        !second.ok
            && second
                .stderr
                .contains(&format!("process {}", coordinator.pid())),
        "{}",
        second.stderr
    );
    scene.release();
    assert!(coordinator.end().ok);
    Book::read(&scene).assert_sound();
}

#[test]
fn a_finished_run_has_nothing_to_do() {
    let scene = Scene::new(2, 0, &worker());
    scene.finish();
    let again = scene.finish();
    assert!(
        again.stdout.contains(r#""submitted":0,"published":0"#),
        "{}",
        again.stdout
    );
    assert_eq!(scene.claims(), 6);
}

/// On a file system of 600 kB the coordinator ends with a clear error, and continues once there is
/// space.
#[test]
fn a_full_disk_ends_the_run_and_loses_nothing() {
    let unshare = ["--user", "--map-root-user", "--mount"];
    let possible = std::process::Command::new("unshare")
        .args(unshare)
        .arg("true")
        .status();
    if !possible.is_ok_and(|status| status.success()) {
        cardiotwin_not_tested::not_tested(
            "own-mounts",
            "unshare may not mount a small file system",
        );
        return;
    }
    let scene = Scene::new(400, 0, "in-process");
    let script = r#"mount -t tmpfs -o size=600k tmpfs "$1" || exit 99
        "$2" "$1/run" 400 0 1 in-process && exit 98
        mount -o remount,size=64m "$1" && "$2" "$1/run" 400 0 1 in-process && cp -r "$1/run" "$3""#;
    let mount = tempfile::tempdir().expect("a directory");
    let run = std::process::Command::new("unshare")
        .args(unshare)
        .args(["sh", "-c", script, "sh"])
        .arg(mount.path())
        .arg(scene::DRIVER)
        .arg(scene.run_dir())
        .output()
        .expect("unshare runs");
    let stderr = String::from_utf8_lossy(&run.stderr);
    assert!(run.status.success(), "{}: {stderr}", run.status);
    assert!(stderr.contains("no space left for"), "{stderr}");
    let book = Book::read(&scene);
    book.assert_sound();
    assert_eq!(book.generations().len(), 1200);
}
