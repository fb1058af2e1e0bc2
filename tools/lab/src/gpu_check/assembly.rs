//! Reads loops and counts instructions in the assembly that ACO, Mesa's compiler for AMD's GPUs, prints: labels `BB7:`,
//! one instruction a line, blocks in the order of the program. A loop is what lies between a branch backward and its
//! label.

use std::collections::BTreeMap;
use std::iter::Sum;
use std::ops::{Add, Mul, RangeInclusive};

use serde::{Deserialize, Serialize};

/// Instructions by kind. Each that stands in the code counts, whether or not a branch leaves it out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Instructions {
    /// One operation of all lanes.
    pub vector: f64,
    /// Of these, those of the transcendental unit, which takes four times as long: powers of 2, logarithms,
    /// reciprocals, roots.
    pub transcendental: f64,
    /// One operation for the whole subgroup.
    pub scalar: f64,
    /// Loads for the whole subgroup.
    pub scalar_loads: f64,
    /// Branches, taken or not.
    pub branches: f64,
    /// Accesses to shared memory, and exchanges between lanes that go through it.
    pub shared: f64,
    /// Accesses to buffers by lane.
    pub memory: f64,
    /// Cycles in which one subgroup alone issues them in their order, a block at a time, with [`DEPENDENT`] cycles from
    /// an instruction to one that needs its result. Loads are not waited for.
    pub alone: f64,
}

/// Cycles from an instruction to one that needs its result.
const DEPENDENT: u32 = 4;

impl Instructions {
    /// Slots of a scheduler that issues one instruction at a time, of whatever kind.
    pub fn slots(&self) -> f64 {
        let Instructions { vector, scalar, scalar_loads, branches, shared, memory, .. } = self;
        vector + scalar + scalar_loads + branches + shared + memory
    }
}

impl Add for Instructions {
    type Output = Instructions;

    fn add(self, b: Instructions) -> Instructions {
        Instructions {
            vector: self.vector + b.vector,
            transcendental: self.transcendental + b.transcendental,
            scalar: self.scalar + b.scalar,
            scalar_loads: self.scalar_loads + b.scalar_loads,
            branches: self.branches + b.branches,
            shared: self.shared + b.shared,
            memory: self.memory + b.memory,
            alone: self.alone + b.alone,
        }
    }
}

impl Mul<f64> for Instructions {
    type Output = Instructions;

    fn mul(self, times: f64) -> Instructions {
        Instructions {
            vector: self.vector * times,
            transcendental: self.transcendental * times,
            scalar: self.scalar * times,
            scalar_loads: self.scalar_loads * times,
            branches: self.branches * times,
            shared: self.shared * times,
            memory: self.memory * times,
            alone: self.alone * times,
        }
    }
}

impl Sum for Instructions {
    fn sum<I: Iterator<Item = Instructions>>(all: I) -> Instructions {
        all.fold(Instructions::default(), Add::add)
    }
}

/// A loop, with the loops inside of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Loop {
    /// Its rounds, if a scalar counts them from one constant to another. Else they depend on the data, or on the lane.
    pub rounds: Option<u32>,
    /// Of one round, without the loops inside.
    pub own: Instructions,
    /// Loops inside.
    pub inner: Vec<Loop>,
}

impl Loop {
    /// One round with the loops inside; those whose rounds are not known count for one round.
    pub fn round(&self) -> Instructions {
        let inner = |inner: &Loop| inner.round() * f64::from(inner.rounds.unwrap_or(1));
        self.own + self.inner.iter().map(inner).sum()
    }

    /// All that stand in it.
    pub fn standing(&self) -> Instructions {
        self.own + self.inner.iter().map(Loop::standing).sum()
    }

    /// Whether it is that loop, or has it inside.
    pub fn contains(&self, other: &Loop) -> bool {
        std::ptr::eq(self, other) || self.inner.iter().any(|inner| inner.contains(other))
    }

    /// Whether the rounds of all loops inside are known.
    fn is_innermost(&self) -> bool {
        self.inner.iter().all(|inner| inner.rounds.is_some() && inner.is_innermost())
    }

    fn and_inner(&self) -> Vec<&Loop> {
        std::iter::once(self).chain(self.inner.iter().flat_map(Loop::and_inner)).collect()
    }
}

/// A program of a pipeline.
pub struct Assembly<'a> {
    lines: Vec<Line<'a>>,
    /// Lines of the labels.
    labels: BTreeMap<&'a str, usize>,
}

#[derive(Clone)]
enum Line<'a> {
    Label(&'a str),
    Code(Code<'a>),
}

#[derive(Clone)]
struct Code<'a> {
    name: &'a str,
    operands: Vec<&'a str>,
}

/// What stands for the first word of an instruction that the disassembler does not know; the second word follows, as if
/// it were an instruction.
const UNREADABLE: &str = "(invalid instruction)";

/// How often the instruction before stands once more, if the line says so: `(then repeated 4 times)`.
fn repeated(line: &str) -> Option<usize> {
    line.strip_prefix("(then repeated ")?.strip_suffix(" times)")?.parse().ok()
}

impl<'a> Assembly<'a> {
    /// Reads a text, up to the data that may follow.
    pub fn of(text: &'a str) -> Assembly<'a> {
        let mut lines: Vec<Line> = Vec::new();
        let code = text.lines().map(|line| line.split(';').next().unwrap_or_default().trim());
        for line in code.take_while(|line| !line.starts_with("/*")) {
            if let Some(label) = line.strip_suffix(':') {
                lines.push(Line::Label(label));
            } else if let Some(times) = repeated(line) {
                lines.extend(lines.last().cloned().into_iter().cycle().take(times));
            } else if !line.is_empty() && line != UNREADABLE {
                let (name, rest) = line.split_once(' ').unwrap_or((line, ""));
                let operands = rest.split(',').map(str::trim).collect();
                lines.push(Line::Code(Code { name, operands }));
            }
        }
        let label = |(at, line): (usize, &Line<'a>)| match line {
            Line::Label(label) => Some((*label, at)),
            Line::Code(_) => None,
        };
        let labels = lines.iter().enumerate().filter_map(label).collect();
        Assembly { lines, labels }
    }

    /// How many instructions stand there, of whatever kind.
    pub fn count(&self) -> usize {
        self.lines.iter().filter(|line| matches!(line, Line::Code(_))).count()
    }

    /// All instructions that do something.
    pub fn instructions(&self) -> Instructions {
        self.counted(&(0..self.lines.len()).collect::<Vec<_>>())
    }

    /// Those of some lines.
    fn counted(&self, lines: &[usize]) -> Instructions {
        let mut sum: Instructions = lines.iter().map(|at| self.lines[*at].counted()).sum();
        let ends_block =
            |at: &usize| !matches!(&self.lines[*at], Line::Code(c) if c.branch().is_none());
        for block in lines.split_inclusive(ends_block) {
            let code: Vec<_> = self.code(block.iter().copied()).map(|(_, code)| code).collect();
            sum.alone += f64::from(cycles_alone(&code));
        }
        sum
    }

    /// The outermost loops, in their order.
    pub fn loops(&self) -> Vec<Loop> {
        // By their first lines; the last branch back to a label ends its loop.
        let mut ranges = BTreeMap::new();
        for (at, line) in self.lines.iter().enumerate() {
            if let Some(to) = self.target(line)
                && to < at
            {
                ranges.insert(to, at);
            }
        }
        let ranges: Vec<_> = ranges.into_iter().map(|(start, end)| start..=end).collect();
        self.nested(&ranges)
    }

    /// Loops of these ranges, which are in the order of their starts.
    fn nested(&self, mut ranges: &[RangeInclusive<usize>]) -> Vec<Loop> {
        let mut loops = Vec::new();
        while let Some((first, rest)) = ranges.split_first() {
            let count = rest.iter().take_while(|range| range.end() <= first.end()).count();
            let (inside, after) = rest.split_at(count);
            let is_own = |at: &usize| !inside.iter().any(|range| range.contains(at));
            let own: Vec<usize> = first.clone().filter(is_own).collect();
            loops.push(Loop {
                rounds: self.rounds(first, &own),
                own: self.counted(&own),
                inner: self.nested(inside),
            });
            ranges = after;
        }
        loops
    }

    /// The line that an instruction branches to.
    fn target(&self, line: &Line) -> Option<usize> {
        let Line::Code(code) = line else { return None };
        code.branch().and_then(|label| self.labels.get(label)).copied()
    }

    fn code(&self, lines: impl Iterator<Item = usize>) -> impl Iterator<Item = (usize, &Code<'a>)> {
        lines.filter_map(|at| match &self.lines[at] {
            Line::Code(code) => Some((at, code)),
            Line::Label(_) => None,
        })
    }

    /// The rounds of a loop that is left when a counter reaches a constant. `own`: its lines that are in no other loop.
    fn rounds(&self, range: &RangeInclusive<usize>, own: &[usize]) -> Option<u32> {
        let rounds = self.code(own.iter().copied()).filter_map(|(step_at, step)| {
            let (by, read) = Step::of(step)?;
            let made = step.operands[0];
            let start = self.before(*range.start(), self.counter(range, made, read)?)?;
            let (test_at, test) = self.test(own, [read, made])?;
            by.rounds(start, &test, test_at > step_at)
        });
        rounds.min()
    }

    /// The test that ends a loop: its first comparison of the counter, if that comes before its first branch, or else
    /// its last one. Those between choose by the counter's value. `None` if it is not with a constant. `names`: the
    /// counter, before and after its step.
    fn test(&self, own: &[usize], names: [&str; 2]) -> Option<(usize, Test)> {
        let is_test = |(_, code): &(usize, &Code)| {
            code.name.starts_with("s_cmp") && code.operands.iter().any(|o| names.contains(o))
        };
        let before_branches = own.iter().take_while(|at| self.target(&self.lines[**at]).is_none());
        let first = self.code(before_branches.copied()).find(is_test);
        let found = first.or_else(|| self.code(own.iter().rev().copied()).find(is_test));
        found.and_then(|(at, code)| Some((at, Test::of(code, names)?)))
    }

    /// The register that a step counts in. It is the one that the step reads, unless something else in the loop writes
    /// it. A copy of the step's own result is allowed.
    fn counter(&self, range: &RangeInclusive<usize>, made: &str, read: &'a str) -> Option<&'a str> {
        let writes =
            |(at, code): &(usize, &Code)| code.writes(read).is_some() && !self.leaves(range, *at);
        let mut writes = self.code(range.clone()).filter(writes);
        let (_, write) = writes.next()?;
        let is_copy = write.name == "s_mov_b32" && write.operands.get(1) == Some(&made);
        (writes.next().is_none() && (made == read || is_copy)).then_some(read)
    }

    /// Whether the block of a line leaves the loop.
    fn leaves(&self, range: &RangeInclusive<usize>, line: usize) -> bool {
        let rest = &self.lines[line..];
        let end = rest.iter().find(|l| matches!(l, Line::Label(_)) || self.target(l).is_some());
        let is_jump = matches!(end, Some(Line::Code(code)) if code.name == "s_branch");
        is_jump && end.and_then(|l| self.target(l)).is_some_and(|to| !range.contains(&to))
    }

    /// The constant that a scalar register holds before a line.
    fn before(&self, line: usize, register: &str) -> Option<u32> {
        let code: Vec<_> = self.code(0..line).collect();
        let (write, high) =
            code.iter().rev().find_map(|(_, code)| Some((code, code.writes(register)?)))?;
        match write.name {
            "s_mov_b32" | "s_movk_i32" => constant(write.operands.get(1)?),
            "s_mov_b64" if high => constant(write.operands.get(1)?).map(|_| 0),
            "s_mov_b64" => constant(write.operands.get(1)?),
            _ => None,
        }
    }
}

/// Cycles until one subgroup has issued a block, each instruction when its operands are there.
fn cycles_alone(block: &[&Code]) -> u32 {
    let mut ready = BTreeMap::new();
    let mut cycle = 0;
    for code in block.iter().filter(|code| !code.calculates_nothing()) {
        let names = || code.operands.iter().flat_map(|operand| registers(operand));
        let start = names().filter_map(|name| ready.get(&name)).fold(cycle, |a, b| a.max(*b));
        cycle = start + 1;
        if code.makes_a_result() {
            ready.extend(registers(code.operands[0]).into_iter().map(|r| (r, start + DEPENDENT)));
        }
    }
    cycle
}

/// The registers of an operand; a pair of conditions counts as its lower half.
fn registers(operand: &str) -> Vec<(char, u32)> {
    let name = operand.trim_matches(['-', '|']).split(' ').next().unwrap_or_default();
    let Some(kind) = name.chars().next().filter(|kind| ['v', 's'].contains(kind)) else {
        return Vec::new();
    };
    if let Some(half) = name.strip_prefix("vcc") {
        return vec![('c', u32::from(half == "_hi"))];
    }
    let rest = &name[1..];
    let range = rest.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')?.split_once(':'));
    let (first, last) = range.unwrap_or((rest, rest));
    match (first.parse(), last.parse::<u32>()) {
        (Ok(first), Ok(last)) => (first..=last).map(|number| (kind, number)).collect(),
        _ => Vec::new(),
    }
}

/// The loop that does a stage's work: of those that depend on the data and have no such loop inside, the one with the
/// most vector instructions a round.
pub fn work_loop(loops: &[Loop]) -> Option<&Loop> {
    let all = loops.iter().flat_map(Loop::and_inner);
    let innermost = all.filter(|l| l.rounds.is_none() && l.is_innermost());
    innermost.max_by(|a, b| a.round().vector.total_cmp(&b.round().vector))
}

const TRANSCENDENTAL: [&str; 7] = ["exp", "log", "rcp", "rsq", "sqrt", "sin", "cos"];
/// Scalar instructions that calculate nothing.
const NOTHING: [&str; 7] =
    ["s_waitcnt", "s_nop", "s_barrier", "s_clause", "s_inst_prefetch", "s_endpgm", "s_code_end"];

impl Line<'_> {
    fn counted(&self) -> Instructions {
        let Line::Code(code) = self else { return Instructions::default() };
        let name = code.name;
        let mut one = Instructions::default();
        let is = |prefixes: &[&str]| prefixes.iter().any(|prefix| name.starts_with(prefix));
        let kind = match name.split_once('_').unwrap_or_default().0 {
            "v" => {
                let function = name[2..].split('_').next().unwrap_or_default();
                one.transcendental = f64::from(u8::from(TRANSCENDENTAL.contains(&function)));
                &mut one.vector
            }
            "s" if is(&["s_load", "s_buffer_load"]) => &mut one.scalar_loads,
            "s" if is(&["s_branch", "s_cbranch"]) => &mut one.branches,
            "s" if code.calculates_nothing() => return one,
            "s" => &mut one.scalar,
            "ds" => &mut one.shared,
            _ => &mut one.memory,
        };
        *kind = 1.0;
        one
    }
}

impl<'a> Code<'a> {
    fn calculates_nothing(&self) -> bool {
        NOTHING.iter().any(|prefix| self.name.starts_with(prefix))
    }

    /// Whether its first operand is a result that is there after some cycles: not a store, and no load, whose value
    /// takes longer.
    fn makes_a_result(&self) -> bool {
        let is_load = ["s_load", "s_buffer"].iter().any(|prefix| self.name.starts_with(prefix));
        (self.name.starts_with("v_") || self.name.starts_with("s_")) && !is_load
    }

    /// The label that it branches to.
    fn branch(&self) -> Option<&'a str> {
        let branches = ["s_branch", "s_cbranch"].iter().any(|name| self.name.starts_with(name));
        branches.then(|| self.operands[0])
    }

    /// Whether it writes a scalar register, and whether as the second of a pair.
    fn writes(&self, register: &str) -> Option<bool> {
        let to = self.operands.first()?;
        let compares = self.name.starts_with("s_cmp") || self.branch().is_some();
        if compares || !to.starts_with('s') {
            return None;
        }
        if *to == register {
            return Some(false);
        }
        let (first, last) = to.strip_prefix("s[")?.strip_suffix(']')?.split_once(':')?;
        let (first, last): (u32, u32) = (first.parse().ok()?, last.parse().ok()?);
        let number: u32 = register.strip_prefix('s')?.parse().ok()?;
        (first..=last).contains(&number).then_some(number > first)
    }
}

/// A whole number as the assembly writes it.
fn constant(operand: &str) -> Option<u32> {
    match operand.strip_prefix("0x") {
        Some(digits) => u32::from_str_radix(digits, 16).ok(),
        None => operand.parse::<i32>().ok().map(|number| number as u32),
    }
}

/// What happens to a counter each round.
#[derive(Clone, Copy)]
enum Step {
    Add(u32),
    Sub(u32),
    Right(u32),
    Left(u32),
}

impl Step {
    /// The step that an instruction takes, and the register that it starts from.
    fn of<'a>(code: &Code<'a>) -> Option<(Step, &'a str)> {
        let [_, a, b] = code.operands[..] else { return None };
        let step = match (code.name, constant(a), constant(b)) {
            ("s_add_u32" | "s_add_i32", _, Some(by)) => (Step::Add(by), a),
            ("s_add_u32" | "s_add_i32", Some(by), _) => (Step::Add(by), b),
            ("s_sub_u32" | "s_sub_i32", _, Some(by)) => (Step::Sub(by), a),
            ("s_lshr_b32", _, Some(by)) => (Step::Right(by), a),
            ("s_lshl_b32", _, Some(by)) => (Step::Left(by), a),
            _ => return None,
        };
        Some(step)
    }

    fn next(self, value: u32) -> u32 {
        match self {
            Step::Add(by) => value.wrapping_add(by),
            Step::Sub(by) => value.wrapping_sub(by),
            Step::Right(by) => value >> (by & 31),
            Step::Left(by) => value << (by & 31),
        }
    }

    /// Rounds until a test gives another answer than in the first one; `after`: the test comes after the step.
    fn rounds(self, start: u32, test: &Test, after: bool) -> Option<u32> {
        const MOST: u32 = 4096;
        let mut value = if after { self.next(start) } else { start };
        let first = test.holds(value);
        for round in 1..=MOST {
            value = self.next(value);
            if test.holds(value) != first {
                return Some(round + u32::from(after));
            }
        }
        None
    }
}

/// A comparison of a counter with a constant.
struct Test {
    comparison: String,
    constant: u32,
    /// Whether the counter is the second operand.
    swapped: bool,
}

impl Test {
    /// `names`: the counter, before and after its step.
    fn of(code: &Code, names: [&str; 2]) -> Option<Test> {
        let rest = code.name.strip_prefix("s_cmpk_").or(code.name.strip_prefix("s_cmp_"))?;
        let [a, b] = code.operands[..] else { return None };
        let swapped = names.contains(&b);
        let constant = constant(if swapped { a } else { b })?;
        (swapped || names.contains(&a)).then(|| Test { comparison: rest.into(), constant, swapped })
    }

    fn holds(&self, counter: u32) -> bool {
        let (comparison, kind) = self.comparison.split_once('_').unwrap_or_default();
        let key = |value: u32| match kind {
            "i32" => i64::from(value as i32),
            _ => i64::from(value),
        };
        let (mut a, mut b) = (key(counter), key(self.constant));
        if self.swapped {
            (a, b) = (b, a);
        }
        match comparison {
            "lt" => a < b,
            "le" => a <= b,
            "gt" => a > b,
            "ge" => a >= b,
            "eq" => a == b,
            _ => a != b,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A loop over data (`BB1`) with one of 32 rounds inside (`BB4`), whose counter is copied and which leaves early in
    /// two ways; then a loop that halves its counter, and ends at the bottom (`BB12`).
    const NESTED: &str = "
BB0:
        s_mov_b32 s0, exec_lo                                       ; be80037e
BB1:
        v_cmp_gt_u32_e32 vcc_lo, s1, v1                             ; 7d880201
        s_cbranch_execz BB9                                         ; bf880005
BB2:
        v_exp_f32_e32 v2, v1
        s_buffer_load_dword s9, s[4:7], 0x4
        s_waitcnt lgkmcnt(0)
        s_mov_b64 s[10:11], 0
BB4:
        s_cmp_lt_u32 s11, 32
        s_cbranch_scc0 BB8
BB5:
        s_cmpk_ge_u32 s11, 0x200
        s_cbranch_scc0 BB7
BB6:
        s_mov_b32 s11, -1
        s_branch BB9
BB7:
        ds_read_b32 v3, v3
        v_add_nc_u32_e32 v4, v4, v3
        s_add_u32 s12, s11, 1
        s_mov_b32 s11, s12
        s_branch BB4
BB8:
        buffer_load_dword v5, v2, s[4:7], 0 offen
        v_mul_f32_e32 v5, v5, v4
        s_branch BB1
BB9:
        s_movk_i32 s20, 0x10
BB12:
        v_mov_b32_e32 v6, v5
        s_lshr_b32 s20, s20, 1
        s_cmp_lg_u32 s20, 0
        s_cbranch_scc1 BB12
BB13:
        s_endpgm
";

    fn loops(text: &str) -> Vec<Loop> {
        Assembly::of(text).loops()
    }

    #[test]
    fn instructions_are_counted_by_kind() {
        let all = Assembly::of(NESTED).instructions();
        let expected = Instructions {
            vector: 5.0,
            transcendental: 1.0,
            scalar: 10.0,
            scalar_loads: 1.0,
            branches: 7.0,
            shared: 1.0,
            memory: 1.0,
            alone: all.alone,
        };
        assert_eq!(all, expected);
    }

    #[test]
    fn repeated_instructions_count_as_often_as_they_stand() {
        let text = "BB0:\n(invalid instruction)\nv_mul_f32_e32 v1, v1, v1\n        (then repeated 4 times)\n\
            s_endpgm\n\n\
            /* constant data */\n00000000\n";
        let assembly = Assembly::of(text);
        assert_eq!((assembly.count(), assembly.instructions().vector), (6, 5.0));
        // Each waits for the one before.
        assert_eq!(assembly.instructions().alone, 17.0);
    }

    #[test]
    fn a_subgroup_alone_waits_for_results() {
        let alone = |text: &str| Assembly::of(text).instructions().alone;
        // Four that need nothing, four in a chain, and a pair of which one half is needed.
        let free =
            ["v_mov_b32 v1, 1.0", "v_mov_b32 v2, 1.0", "v_mov_b32 v3, 1.0", "v_mov_b32 v4, v0"];
        assert_eq!(alone(&free.join("\n")), 4.0);
        let chain =
            ["v_mov_b32 v1, v0", "v_mul_f32 v2, -|v1|, v0", "v_mov_b32 v3, v2", "v_mov_b32 v4, v3"];
        assert_eq!(alone(&chain.join("\n")), 13.0);
        let pair =
            ["v_mov_b64 v[6:7], 0", "v_mov_b32 v1, v7", "s_waitcnt vmcnt(0)", "v_mov_b32 v2, v0"];
        assert_eq!(alone(&pair.join("\n")), 6.0);
        // A new block begins anew; a load is not waited for.
        assert_eq!(alone("v_mov_b32_e32 v1, 1.0\nBB1:\nv_mov_b32_e32 v2, v1\n"), 2.0);
        assert_eq!(alone("buffer_load_dword v1, v0, s[4:7], 0 offen\nv_mov_b32_e32 v2, v1\n"), 2.0);
        assert_eq!(
            alone("v_cmp_lt_u32_e32 vcc_lo, s1, v1\nv_cndmask_b32_e32 v1, 0, v2, vcc_lo\n"),
            5.0
        );
    }

    #[test]
    fn loops_are_nested() {
        let loops = loops(NESTED);
        let [outer, halving] = &loops[..] else { panic!("{loops:#?}") };
        assert_eq!(outer.rounds, None);
        let own = [outer.own.vector, outer.own.transcendental, outer.own.memory, outer.own.shared];
        assert_eq!(own, [3.0, 1.0, 1.0, 0.0]);
        let [inner] = &outer.inner[..] else { panic!("{outer:#?}") };
        assert_eq!((inner.rounds, inner.own.vector, inner.own.shared), (Some(32), 1.0, 1.0));
        assert!(inner.inner.is_empty());
        assert_eq!((halving.rounds, halving.own.vector), (Some(5), 1.0));
    }

    #[test]
    fn a_round_has_the_rounds_inside() {
        let round = loops(NESTED)[0].round();
        assert_eq!((round.vector, round.shared, round.memory), (3.0 + 32.0, 32.0, 1.0));
    }

    #[test]
    fn the_work_is_done_by_the_innermost_loop_over_data() {
        let loops = loops(NESTED);
        assert_eq!(work_loop(&loops), Some(&loops[0]));
        assert_eq!(work_loop(&loops[1..]), None);
        let outer = |inner| Loop { rounds: None, own: Instructions::default(), inner };
        let around = outer(vec![outer(vec![]), loops[0].clone()]);
        assert_eq!(work_loop(&[around]), Some(&loops[0]));
    }

    #[test]
    fn rounds_that_depend_on_data_are_not_known() {
        // Against a register; with a step that another instruction changes; from a start that is not constant.
        for (from, to) in [
            ("s_cmp_lt_u32 s11, 32", "s_cmp_lt_u32 s11, s9"),
            ("ds_read_b32 v3, v3", "s_and_b32 s11, s11, s9"),
            ("s_mov_b64 s[10:11], 0", "s_mov_b64 s[10:11], s[8:9]"),
        ] {
            assert_eq!(loops(&NESTED.replace(from, to))[0].inner[0].rounds, None, "{to}");
        }
    }

    #[test]
    fn tests_at_the_top_and_at_the_bottom_count_the_same_rounds() {
        let top = "s_mov_b32 s0, 0\nBB1:\ns_cmp_lt_u32 s0, 6\ns_cbranch_scc0 BB2\n\
            s_add_u32 s0, s0, 2\ns_branch BB1\nBB2:\n";
        let bottom = "s_mov_b32 s0, 6\nBB1:\ns_sub_i32 s0, s0, 2\ns_cmp_ge_i32 0, s0\n\
            s_cbranch_scc0 BB1\nBB2:\n";
        for text in [top, bottom] {
            assert_eq!(loops(text)[0].rounds, Some(3), "{text}");
        }
    }
}
