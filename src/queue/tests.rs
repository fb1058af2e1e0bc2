use super::*;

const LONG: Duration = Duration::from_secs(60);

#[derive(Debug, PartialEq, thiserror::Error)]
enum Failure {
    #[error(transparent)]
    Queue(#[from] QueueError),
    #[error("three")]
    Three,
    #[error("no room")]
    Room,
}

struct Joined(Option<std::thread::JoinHandle<()>>);

impl Drop for Joined {
    fn drop(&mut self) {
        self.0.take().map(std::thread::JoinHandle::join);
    }
}

fn spawn(_: usize, body: Body) -> Result<Box<dyn Send>, Failure> {
    Ok(Box::new(Joined(Some(std::thread::spawn(body)))))
}

/// A queue whose slots take what its first worker counts, from `counted` on. The worker fails at 3 and panics at 5.
fn queue(slots: usize, workers: usize, counted: u32, pause: u64) -> (Queue<u32, Failure>, Lost) {
    let mut count = counted;
    let first = move |slot: &mut u32| {
        std::thread::sleep(Duration::from_millis(pause));
        count += 1;
        *slot = count;
        match *slot {
            3 => Err(Failure::Three),
            5 => panic!("on purpose"),
            _ => Ok(()),
        }
    };
    let mut all: Vec<Worker<u32, Failure>> = vec![Box::new(first)];
    if workers > 1 {
        all.push(Box::new(|slot| {
            *slot *= 10;
            Ok(())
        }));
    }
    let lost = Lost::default();
    (Queue::new(all, vec![0; slots], lost.clone(), Box::new(spawn)), lost)
}

fn taken(queue: &mut Queue<u32, Failure>) -> Result<u32, Failure> {
    let mut found = 0;
    queue.wait(LONG)?;
    queue.take(|slot| {
        found = *slot;
        Ok(())
    })?;
    Ok(found)
}

const fn failure(error: QueueError) -> Failure {
    Failure::Queue(error)
}

#[test]
fn results_are_taken_once_and_failures_end_their_frame_only() {
    let (mut queue, _) = queue(1, 1, 0, 0);
    assert_eq!(queue.wait(Duration::ZERO), Err(QueueError::Empty));
    queue.begin(|_| Ok(())).unwrap();
    assert_eq!(queue.wait(LONG), Ok(true));
    assert_eq!(queue.take(|_| Err(Failure::Room)), Err(Failure::Room));
    assert_eq!(taken(&mut queue), Ok(1));
    assert_eq!(queue.take(|_| Ok(())), Err(failure(QueueError::Empty)));
    queue.run(|_| Ok(())).unwrap();
    assert_eq!(taken(&mut queue), Ok(2));
    queue.begin(|_| Ok(())).unwrap();
    assert_eq!(taken(&mut queue), Err(Failure::Three));
    assert_eq!(queue.check_idle(), Ok(()));
    queue.run(|_| Ok(())).unwrap();
    assert_eq!(taken(&mut queue), Ok(4));
}

#[test]
fn only_a_result_that_could_not_be_handed_over_is_dropped_by_the_next_frame() {
    let (mut queue, lost) = queue(1, 1, 0, 0);
    queue.begin(|_| Ok(())).unwrap();
    assert_eq!(queue.wait(LONG), Ok(true));
    assert_eq!(queue.check_idle(), Err(QueueError::UnderWay));
    assert_eq!(queue.begin(|_| Ok(())), Err(failure(QueueError::Full)));
    assert_eq!(queue.run(|_| Ok(())), Err(failure(QueueError::UnderWay)));
    assert_eq!(queue.take(|_| Err(Failure::Room)), Err(Failure::Room));
    assert_eq!(queue.check_idle(), Ok(()));
    assert_eq!(queue.begin(|_| Err(Failure::Room)), Err(Failure::Room), "it cannot be filled");
    assert!(!lost.take(), "what is kept is still there");
    queue.begin(|_| Ok(())).unwrap();
    assert_eq!(taken(&mut queue), Ok(2));
    assert!(lost.take());
}

#[test]
fn a_panic_of_a_worker_is_told_and_poisons_the_queue() {
    for here in [false, true] {
        let (mut queue, _) = queue(1, 1, 4, 0);
        let begun = if here { queue.run(|_| Ok(())) } else { queue.begin(|_| Ok(())) };
        assert_eq!(begun, Ok(()));
        assert_eq!(taken(&mut queue), Err(failure(QueueError::Panicked)));
        assert_eq!(queue.begin(|_| Ok(())), Err(failure(QueueError::Poisoned)));
        assert_eq!(queue.check_idle(), Err(QueueError::Poisoned));
    }
}

#[test]
fn what_was_begun_is_left_alone_until_it_ends() {
    let (mut queue, _) = queue(1, 1, 0, 200);
    queue.begin(|_| Ok(())).unwrap();
    assert_eq!(queue.check_first_worker(), Err(QueueError::UnderWay));
    assert_eq!(queue.begin(|_| Ok(())), Err(failure(QueueError::Full)));
    assert_eq!(queue.take(|_| Ok(())), Ok(false));
    assert_eq!(taken(&mut queue), Ok(1));
    queue.begin(|_| Ok(())).unwrap();
    drop(queue); // Waits, and does not hang.
}

#[test]
fn what_is_cancelled_ends_without_a_result() {
    let (mut queue, lost) = queue(1, 1, 0, 100);
    assert!(queue.cancel(), "nothing was begun");
    queue.begin(|_| Ok(())).unwrap();
    while queue.check_first_worker().is_ok() {}
    std::thread::sleep(Duration::from_millis(20));
    assert!(!queue.cancel());
    assert_eq!(queue.begin(|_| Ok(())), Err(failure(QueueError::Ending)));
    assert_eq!(queue.wait(LONG), Err(QueueError::Empty), "it ended, and nothing is left");
    assert_eq!(queue.check_idle(), Ok(()));
    assert!(lost.take() && !lost.take());
    queue.begin(|_| Ok(())).unwrap();
    assert_eq!(queue.wait(LONG), Ok(true));
    assert!(queue.cancel());
    assert!(lost.take());
    queue.begin(|_| Ok(())).unwrap();
    queue.cancel();
    drop(queue); // Waits, and does not hang.
}

#[test]
fn two_frames_go_through_two_workers_in_order() {
    let (mut queue, lost) = queue(2, 2, 0, 20);
    queue.begin(|_| Ok(())).unwrap();
    queue.begin(|_| Ok(())).unwrap();
    assert_eq!(queue.begin(|_| Ok(())), Err(failure(QueueError::Full)));
    assert_eq!(taken(&mut queue), Ok(10));
    queue.begin(|_| Ok(())).unwrap();
    assert_eq!(taken(&mut queue), Ok(20));
    assert_eq!(taken(&mut queue), Err(Failure::Three), "the second worker leaves it alone");
    queue.run(|_| Ok(())).unwrap();
    assert_eq!(taken(&mut queue), Ok(40));
    assert!(!lost.take());
}
