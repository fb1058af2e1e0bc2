//! Runs the workgroups of a dispatch. An invocation runs until it must wait for others, or until the seed has another
//! one go on.

use crate::error::{Error, Place};
use crate::memory::Memory;
use crate::ops;
use crate::program::{Collective, Input, Instruction, Module, Reg, Space};
use crate::races::Fault;
use crate::subgroups::{self, Lane};
use crate::turn::{Invocation, State, Stop, Trouble, Turn};

/// What a module is run with.
#[derive(Clone, Copy, Debug)]
pub struct Dispatch<'a> {
    /// Workgroups along each axis.
    pub groups: [u32; 3],
    /// Push constants.
    pub push: &'a [u32],
    /// Specialisation constants: numbers and values.
    pub constants: &'a [(u32, u32)],
    /// Lanes of a subgroup.
    pub subgroup: u32,
    /// What the order of workgroups and invocations is drawn from, and which invocations are a subgroup. 0: all in
    /// turn.
    pub seed: u64,
}

/// What a run took.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Counts {
    /// Instructions of all invocations.
    pub instructions: u64,
    /// Workgroups.
    pub groups: u64,
}

/// Most instructions of a workgroup.
const MOST_INSTRUCTIONS: u64 = 1 << 32;

/// Most accesses to memory before another invocation goes on.
const MOST_ACCESSES: u32 = 48;

/// The largest subgroups that must pass equally many barriers of their own.
const MOST_EVEN: u32 = 16;

/// What lies in registers and memory that nobody wrote.
const GARBAGE: u32 = 0xbad0_cafe;

impl Module {
    /// Runs the workgroups of a dispatch, on the buffers of bindings 0, 1, …
    pub fn run(&self, dispatch: &Dispatch, buffers: &mut [Vec<u32>]) -> Result<Counts, Error> {
        let fault = |what: String| Error::Dispatch { entry: self.entry.clone(), what };
        if (buffers.len() as u32) < self.bindings {
            return Err(fault(format!("{} buffers, not {}", self.bindings, buffers.len())));
        }
        if !(1..=128).contains(&dispatch.subgroup) || self.invocations() == 0 {
            return Err(fault(format!("subgroups of {}", dispatch.subgroup)));
        }
        let memory = Memory::new(buffers, self.shared_words, dispatch.push);
        let mut run = Run::new(self, dispatch, memory);
        let [x, y, z] = dispatch.groups;
        let mut order: Vec<u64> = (0..u64::from(x) * u64::from(y) * u64::from(z)).collect();
        run.random.shuffle(&mut order);
        for number in order {
            let (x, y) = (u64::from(x), u64::from(y));
            let group = [number % x, number / x % y, number / (x * y)].map(|v| v as u32);
            run.group(group, number as u32 + 1)?;
        }
        Ok(run.counts)
    }
}

/// Numbers from a seed (xorshift). Seed 0 has no choice.
struct Random(u64);

impl Random {
    fn new(seed: u64) -> Random {
        Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15))
    }

    /// A number below `limit`.
    fn below(&mut self, limit: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        ((self.0 >> 11) % limit as u64) as usize
    }

    fn has_choice(&self) -> bool {
        self.0 != 0
    }

    fn shuffle<T>(&mut self, items: &mut [T]) {
        for i in (1..items.len()).rev() {
            if self.has_choice() {
                let other = self.below(i + 1);
                items.swap(i, other);
            }
        }
    }
}

struct Run<'a> {
    module: &'a Module,
    dispatch: &'a Dispatch<'a>,
    memory: Memory<'a>,
    random: Random,
    counts: Counts,
    invocations: Vec<Invocation>,
    /// Invocations of each subgroup, by lane.
    subgroups: Vec<Vec<usize>>,
    /// How many of each subgroup neither wait nor have ended.
    running: Vec<usize>,
    /// Barriers that each subgroup passed by itself since the last one of the workgroup.
    passed: Vec<u32>,
    ready: Vec<usize>,
    group: [u32; 3],
    /// From 1.
    group_number: u32,
}

impl<'a> Run<'a> {
    fn new(module: &'a Module, dispatch: &'a Dispatch, memory: Memory<'a>) -> Run<'a> {
        let mut registers = module.registers.clone();
        for (number, value) in dispatch.constants {
            for (_, reg) in module.constants.iter().filter(|(own, _)| own == number) {
                registers[*reg as usize] = *value;
            }
        }
        for (k, reg) in (0..).zip(&module.undefined) {
            registers[*reg as usize] = GARBAGE ^ k;
        }
        let size = dispatch.subgroup;
        let invocation = |i: u32| Invocation {
            registers: registers.clone(),
            at: 0,
            state: State::Ready,
            subgroup: i / size,
            lane: i % size,
        };
        Run {
            module,
            dispatch,
            memory,
            random: Random::new(dispatch.seed),
            counts: Counts::default(),
            invocations: (0..module.invocations()).map(invocation).collect(),
            subgroups: Vec::new(),
            running: Vec::new(),
            passed: Vec::new(),
            ready: Vec::new(),
            group: [0; 3],
            group_number: 0,
        }
    }

    /// Runs a workgroup.
    fn group(&mut self, group: [u32; 3], number: u32) -> Result<(), Error> {
        (self.group, self.group_number) = (group, number);
        self.start();
        let limit = self.counts.instructions + MOST_INSTRUCTIONS;
        loop {
            while let Some(i) = self.next() {
                self.resume(i, limit)?;
            }
            // Nobody can go on. At a barrier of the workgroup all wait; else it has ended.
            if !self.pass_group()? {
                break;
            }
        }
        self.counts.groups += 1;
        Ok(())
    }

    /// Sets all invocations to the first instruction, and draws which of them are a subgroup.
    fn start(&mut self) {
        let count = self.invocations.len();
        let mut order: Vec<usize> = (0..count).collect();
        self.random.shuffle(&mut order);
        let size = self.dispatch.subgroup as usize;
        self.subgroups = order.chunks(size).map(<[usize]>::to_vec).collect();
        self.running = self.subgroups.iter().map(Vec::len).collect();
        self.passed = vec![0; self.subgroups.len()];
        for (subgroup, members) in self.subgroups.iter().enumerate() {
            for (lane, i) in members.iter().enumerate() {
                let invocation = &mut self.invocations[*i];
                (invocation.subgroup, invocation.lane) = (subgroup as u32, lane as u32);
                (invocation.at, invocation.state) = (0, State::Ready);
            }
        }
        self.memory.start(self.subgroups.len(), GARBAGE ^ self.group_number);
        (0..count).for_each(|i| self.set_inputs(i));
        // The first one is taken from the end.
        self.ready = (0..count).rev().collect();
    }

    fn set_inputs(&mut self, i: usize) {
        let [width, height, _] = self.module.size;
        let index = i as u32;
        let local = [index % width, index / width % height, index / (width * height)];
        let global: [u32; 3] =
            std::array::from_fn(|axis| self.group[axis] * self.module.size[axis] + local[axis]);
        let subgroups = self.subgroups.len() as u32;
        let invocation = &mut self.invocations[i];
        for (input, reg) in &self.module.inputs {
            let word = |word| [word, 0, 0];
            let value = match input {
                Input::GroupCount => self.dispatch.groups,
                Input::Group => self.group,
                Input::Local => local,
                Input::Global => global,
                Input::Index => word(index),
                Input::Subgroup => word(invocation.subgroup),
                Input::Lane => word(invocation.lane),
                Input::SubgroupSize => word(self.dispatch.subgroup),
                Input::SubgroupCount => word(subgroups),
            };
            let words = input.words() as usize;
            invocation.registers[*reg as usize..][..words].copy_from_slice(&value[..words]);
        }
        for (to, from) in &self.module.first_values {
            invocation.registers[*to as usize] = invocation.registers[*from as usize];
        }
    }

    /// An invocation that can go on.
    fn next(&mut self) -> Option<usize> {
        if self.ready.is_empty() {
            return None;
        }
        let at = if self.random.has_choice() {
            self.random.below(self.ready.len())
        } else {
            self.ready.len() - 1
        };
        Some(self.ready.swap_remove(at))
    }

    fn resume(&mut self, i: usize, limit: u64) -> Result<(), Error> {
        let accesses = if self.random.has_choice() {
            1 + self.random.below(MOST_ACCESSES as usize)
        } else {
            0
        };
        let invocation = &mut self.invocations[i];
        let who = self.memory.accessor(i as u32, invocation.subgroup, self.group_number);
        let mut turn = Turn {
            module: self.module,
            memory: &mut self.memory,
            who,
            accesses: accesses as u32,
            instructions: &mut self.counts.instructions,
            limit,
        };
        match turn.run(invocation) {
            Ok(Stop::Yields) => {
                self.ready.push(i);
                Ok(())
            }
            Ok(Stop::Waits) => {
                self.invocations[i].state = State::Waiting;
                self.meet(i)
            }
            Ok(Stop::Ends) => {
                self.invocations[i].state = State::Ended;
                self.meet(i)
            }
            Err(trouble) => Err(self.error(i, trouble)),
        }
    }

    /// Invocations of a subgroup, by lane, that are in this state.
    fn in_state(&self, subgroup: u32, state: State) -> Vec<usize> {
        let members = self.subgroups[subgroup as usize].iter().copied();
        members.filter(|i| self.invocations[*i].state == state).collect()
    }

    /// An invocation waits or has ended. If it was the last of its subgroup to run, goes on with those that wait.
    fn meet(&mut self, i: usize) -> Result<(), Error> {
        let subgroup = self.invocations[i].subgroup;
        self.running[subgroup as usize] -= 1;
        if self.running[subgroup as usize] > 0 {
            return Ok(());
        }
        let waiting = self.in_state(subgroup, State::Waiting);
        let Some(first) = waiting.first().copied() else { return Ok(()) };
        let at = self.invocations[first].at;
        if let Some(other) = waiting.iter().find(|other| self.invocations[**other].at != at) {
            return Err(self.divergent(first, *other));
        }
        match self.module.code[at as usize] {
            Instruction::Collective { op, to, a, b } => self.collect(op, to, [a, b], &waiting)?,
            Instruction::Barrier(barrier) => {
                if let Some(other) = self.in_state(subgroup, State::Ended).first() {
                    return Err(self.divergent(first, *other));
                }
                if !barrier.of_subgroup {
                    return Ok(());
                }
                self.memory.pass(barrier, subgroup);
                self.passed[subgroup as usize] += 1;
            }
            _ => return Ok(()),
        }
        self.release(&waiting);
        Ok(())
    }

    /// Lets invocations go on behind the instruction at which they waited.
    fn release(&mut self, waiting: &[usize]) {
        for i in waiting {
            let invocation = &mut self.invocations[*i];
            invocation.at += 1;
            invocation.state = State::Ready;
            self.running[invocation.subgroup as usize] += 1;
        }
        self.ready.extend(waiting.iter().rev());
    }

    fn collect(
        &mut self,
        op: Collective,
        to: Reg,
        [a, b]: [Reg; 2],
        waiting: &[usize],
    ) -> Result<(), Error> {
        let of = |i: &usize| {
            let invocation = &self.invocations[*i];
            let [a, b] = [a, b].map(|reg| invocation.registers[reg as usize]);
            Lane { number: invocation.lane, a, b }
        };
        let lanes: Vec<Lane> = waiting.iter().map(of).collect();
        let in_turn = self.dispatch.seed.is_multiple_of(2);
        let results = subgroups::together(op, &lanes, in_turn)
            .map_err(|(at, lane)| Error::InactiveLane { place: self.place(waiting[at]), lane })?;
        let words = op.words() as usize;
        for (i, result) in waiting.iter().zip(results) {
            let registers = &mut self.invocations[*i].registers;
            registers[to as usize..][..words].copy_from_slice(&result[..words]);
        }
        Ok(())
    }

    /// Goes on behind a barrier of the workgroup, if all wait there. Returns whether anybody goes on.
    fn pass_group(&mut self) -> Result<bool, Error> {
        self.compare_passed()?;
        let of = |state| self.invocations.iter().position(|one| one.state == state);
        let Some(first) = of(State::Waiting) else { return Ok(false) };
        if let Some(other) = of(State::Ended) {
            return Err(self.divergent(first, other));
        }
        let at = self.invocations[first].at;
        if let Some(other) = self.invocations.iter().position(|one| one.at != at) {
            return Err(self.divergent(first, other));
        }
        if let Instruction::Barrier(barrier) = self.module.code[at as usize] {
            self.memory.pass(barrier, 0);
        }
        let all: Vec<usize> = (0..self.invocations.len()).collect();
        self.release(&all);
        Ok(true)
    }

    /// Fails unless all subgroups passed as many barriers of their own. Large subgroups are not compared: see
    /// [`Error::Uneven`].
    fn compare_passed(&mut self) -> Result<(), Error> {
        if self.dispatch.subgroup > MOST_EVEN {
            return Ok(());
        }
        let first = self.passed[0];
        if let Some(other) = self.passed.iter().position(|passed| *passed != first) {
            return Err(Error::Uneven {
                entry: self.module.entry.clone(),
                group: self.group,
                barriers: [first, self.passed[other]],
                other: other as u32,
            });
        }
        self.passed.fill(0);
        Ok(())
    }

    fn place(&self, i: usize) -> Box<Place> {
        let (op, word) = self.module.origins[self.invocations[i].at as usize];
        Box::new(Place {
            entry: self.module.entry.clone(),
            instruction: ops::name(op),
            word,
            group: self.group,
            invocation: i as u32,
        })
    }

    fn divergent(&self, waiting: usize, other: usize) -> Error {
        let what = if self.invocations[other].state == State::Ended {
            format!("invocation {other} has ended")
        } else {
            let Place { instruction, word, .. } = *self.place(other);
            format!("invocation {other} is at {instruction} at word {word}")
        };
        Error::Divergent { place: self.place(waiting), other: what }
    }

    fn error(&self, i: usize, trouble: Trouble) -> Error {
        let place = self.place(i);
        let (space, fault) = match trouble {
            Trouble::Memory(space, fault) => (space, fault),
            Trouble::DividesByZero => return Error::DividesByZero(place),
            Trouble::Unreachable => return Error::Unreachable(place),
            Trouble::Endless => return Error::Endless(place, MOST_INSTRUCTIONS),
        };
        let memory = match space {
            Space::Storage(binding) => format!("binding {binding}"),
            Space::Shared => "shared memory".into(),
            Space::Push => "the push constants".into(),
            Space::Own => "a variable".into(),
        };
        match fault {
            Fault::Bounds { index } => Error::OutOfBounds { place, memory, index },
            Fault::Race { word, access, other } => {
                Error::Race { place, access, memory, word, other }
            }
            Fault::Equal { word, other } => Error::EqualWrites { place, memory, word, other },
            Fault::Groups { word, access } => Error::GroupRace { place, access, memory, word },
            Fault::Unwritten { word } => Error::Unwritten { place, word },
        }
    }
}
