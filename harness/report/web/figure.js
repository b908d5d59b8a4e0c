"use strict";
// One chart as a Bokeh figure: its models, their data in a range, and their colours.
(() => {
  const GS = GoughStewart;
  const FONT = 'system-ui, "Segoe UI", sans-serif', LEFT = 68, RIGHT = 14, AIR = 0.06, NEAR = 0.02, STRIP = 0.032;

  const times = (values, factor) => (factor === 1 ? values : values.map((v) => factor * v));
  // The numbers of a chart, in the units shown.
  const unpacked = async (chart) => {
    const x = times(await GS.array(chart.x.values), chart.x.factor), { factor } = chart.y;
    const one = async (number, by) => (number === undefined ? undefined : times(await GS.array(number), by));
    const all = await Promise.all(chart.series.map(async (each) => ({
      x: each.x === undefined ? x : await one(each.x, chart.x.factor), y: await one(each.values, each.y?.factor ?? factor),
      low: await one(each.low, factor), high: await one(each.high, factor), members: await one(each.members, 1),
    })));
    const { map, rows } = chart, of = async (axis) => axis && times(await GS.array(axis.values), axis.factor);
    return { x, all, rows: await of(rows), slices: await of(map?.slices), inside: map && map.inside !== null ? await GS.array(map.inside) : null };
  };

  const extent = (list) => {
    let low = Infinity, high = -Infinity;
    for (const values of list) for (const v of values || []) { if (v < low) low = v; if (v > high) high = v; }
    return low <= high ? [low, high] : null;
  };
  // Both ends of an axis with some air, at least the resolution of display apart.
  const airy = (found, least, isLog) => {
    if (!found) return isLog ? [0.1, 10] : [-least, least];
    const [low, high] = found;
    if (isLog) return [low / (high / low) ** AIR / 1.02, high * (high / low) ** AIR * 1.02];
    const span = Math.max(high - low, least), middle = low + (high - low) / 2;
    return [middle - (0.5 + AIR) * span, middle + (0.5 + AIR) * span];
  };

  const ROUND = [1, 2, 3, 5, 7].flatMap((v) => [-3, -2, -1, 0, 1, 2, 3, 4, 5].map((e) => v * 10 ** e)).sort((a, b) => a - b);
  // Ticks of logarithmic axes and colours: round numbers, as many as there is room for.
  GS.roundTicks = (low, high) => {
    // within a factor of four evenly spaced ones are rounder
    if (high < 4 * low) {
      const rough = (high - low) / 5, power = 10 ** Math.floor(Math.log10(rough)), step = power * [1, 2, 5, 10].find((v) => v * power >= rough);
      return Array.from({ length: 8 }, (_, k) => Number((step * (Math.ceil(low / step) + k)).toPrecision(6))).filter((v) => v <= high);
    }
    const inside = ROUND.filter((v) => v >= low * 0.999 && v <= high * 1.001), step = Math.ceil(inside.length / 7);
    return inside.filter((_, k) => k % step === 0);
  };

  // Powers of ten only where decimals would be long.
  const plain = (axis, start, end) => {
    const most = Math.max(Math.abs(start), Math.abs(end));
    axis.formatter.setv({ use_scientific: most >= 1e6 || most < 1e-6 });
  };

  // Within two decades round numbers, with room for each; else powers of ten.
  const logTicks = (axis, start, end) => { axis.ticker = end < 100 * start ? new Bokeh.FixedTicker({ ticks: GS.roundTicks(start, end) }) : new Bokeh.LogTicker(); };

  const said = (value, { digits, unit }) => `${GS.short(value, digits)} ${unit}`.trim();

  class Figure {
    constructor(chart, host, data) {
      Object.assign(this, { chart, host, data, parts: [], spans: [], isTime: chart.isTime, others: new Map() });
      this.isFunction = chart.kind === "line" || chart.kind === "step";
      this.groups = GS.coinciding(chart, data.all);
      this.bars = chart.kind === "bars";
      // long names of bars stand at the left
      this.lying = this.bars && (chart.x.labels.join("").length > 40 || chart.x.labels.length > 12);
      const { figure } = Bokeh.Plotting, logX = chart.x.scale === "log", logY = chart.y.scale === "log";
      const titles = [chart.x.title, chart.y.title];
      if (this.lying) titles.reverse();
      this.figure = figure({
        sizing_mode: "stretch_both", tools: "", toolbar_location: "above", output_backend: "canvas", match_aspect: false,
        x_axis_type: logX ? "log" : "linear", y_axis_type: logY ? "log" : "linear",
        x_range: new Bokeh.Range1d({ start: 0, end: 1 }), y_range: new Bokeh.Range1d({ start: 0, end: 1 }),
        x_axis_label: titles[0], y_axis_label: titles[1], min_border_left: this.lying ? 10 : LEFT, min_border_right: RIGHT,
        min_border_top: 8, min_border_bottom: 44, background_fill_color: null, border_fill_color: null, outline_line_color: null,
      });
      this.figure.toolbar_inner = true;
      this.build();
      this.tools();
      for (const mark of chart.marks) {
        const span = new Bokeh.Span({ location: mark.value * (mark.vertical ? chart.x.factor : chart.y.factor), dimension: mark.vertical ? "height" : "width", line_width: 1.4 });
        this.figure.add_layout(span);
        this.spans.push({ span, mark });
      }
      this.margins();
      this.strips();
    }

    // Bokeh's tools, those that this chart uses: a drag marks a range, picks members or zooms a map.
    tools() {
      const { chart, figure, parts } = this, { toolbar } = figure, isMap = chart.kind === "heat";
      const picks = parts.some(({ numbers }) => numbers.members) && chart.kind === "points", dimensions = isMap || chart.kind === "points" ? "both" : "width";
      this.saveTool = new Bokeh.SaveTool({ filename: chart.title });
      const mark = (this.isFunction || picks) && new Bokeh.BoxSelectTool({ dimensions: "width", renderers: picks ? "auto" : [], description: picks ? "pick members" : "mark a range" });
      const zoom = this.bars ? [] : [new Bokeh.PanTool({ dimensions }), new Bokeh.BoxZoomTool({ dimensions }), new Bokeh.WheelZoomTool({ dimensions }), new Bokeh.ResetTool()];
      const told = parts.flatMap(({ glyphs }) => glyphs).filter(({ kind }) => kind === "point" || kind === "bar").map(({ made }) => made);
      const inspect = this.isFunction ? [new Bokeh.CrosshairTool({ dimensions: "width", line_color: "#888888", line_alpha: 0.6 })] : told.length ? [new Bokeh.HoverTool({ renderers: told, tooltips: "@told" })] : [];
      // over the curves, of which only its buttons hide a part
      toolbar.setv({ autohide: true, stylesheets: [":host { pointer-events: none; } :host > * { pointer-events: auto; }"] });
      figure.add_tools(...[mark, picks && new Bokeh.TapTool()].filter(Boolean), ...zoom, ...inspect, this.saveTool);
      toolbar.active_drag = matchMedia("(pointer: coarse)").matches ? null : mark || (isMap ? zoom[1] : null);
      toolbar.active_scroll = null;
    }

    // Margins as thick lines from end to end, with their text beside them.
    margins() {
      const { chart, figure } = this;
      this.texts = chart.spans.map((span) => {
        const x = span.at * chart.x.factor, [y0, y1] = [span.low, span.high].map((v) => v * chart.y.factor);
        const line = figure.segment({ x0: x, x1: x, y0, y1, line_width: 3 });
        const text = new Bokeh.Label({ x, y: y0, text: span.text, text_font: FONT, text_font_size: "12px", text_baseline: "top", y_offset: -2, padding: 2 });
        figure.add_layout(text);
        return { span, line, text, ends: [y0, y1], x };
      });
    }

    // When limits are active: bars at the lower edge, one row for each.
    strips() {
      const { chart, figure } = this, F = (field) => ({ field });
      if (!chart.strips.length) return;
      figure.extra_y_ranges = new Map([["strips", new Bokeh.Range1d({ start: 0, end: 1 })]]);
      this.bands = chart.strips.map((strip, k) => {
        const bottom = STRIP * (k + 0.2), pick = (side) => strip.intervals.map((ends) => chart.x.factor * ends[side]);
        const source = new Bokeh.ColumnDataSource({ data: { left: pick(0), right: pick(1) } });
        // a border, so that the shortest is seen
        return { strip, made: figure.quad({ left: F("left"), right: F("right"), bottom, top: bottom + 0.75 * STRIP, source, y_range_name: "strips", line_width: 1 }) };
      });
    }

    async show() {
      this.dress();
      this.fit();
      this.view = await Bokeh.Plotting.show(this.figure, this.host);
      return this;
    }

    // Signals of a second and further unit have an axis of their own at the right.
    rangeOf({ y }) {
      const { chart: { units }, figure } = this, name = y?.unit || "1";
      if (!units || y.unit === units[0]) return {};
      if (!this.others.has(name)) {
        const range = new Bokeh.Range1d({ start: 0, end: 1 });
        range.least = y.span;
        this.others.set(name, range);
        figure.extra_y_ranges = new Map(this.others);
        figure.add_layout(new Bokeh.LinearAxis({ y_range_name: name, axis_label: `[${name}]` }), "right");
      }
      return { y_range_name: name };
    }

    // Glyphs by kind.
    build() {
      const { chart, figure, data } = this, F = (field) => ({ field });
      chart.series.forEach((series, k) => {
        const numbers = data.all[k], source = new Bokeh.ColumnDataSource({ data: {} }), part = { series, numbers, source, glyphs: [] };
        const add = (made, kind) => { part.glyphs.push({ made, kind }); return made; };
        if (this.isFunction) {
          if (numbers.low) add(figure.varea({ x: F("x"), y1: F("low"), y2: F("high"), source }), "band");
          if (series.role !== "band") {
            const columns = { x: F("x"), y: F("y"), source, ...this.rangeOf(series) };
            add(chart.kind === "step" || series.step ? figure.step({ ...columns, mode: "after" }) : figure.line(columns), "line");
            // a single row is a point
            if (numbers.y.length === 1) add(figure.scatter({ x: F("x"), y: F("y"), source, size: 6 }), "dot");
          }
        } else if (chart.kind === "points") {
          const told = [...numbers.y].map((y, i) => `${numbers.members ? `member ${numbers.members[i]}: ` : ""}${said(numbers.x[i], chart.x)}, ${said(y, chart.y)}`);
          source.data = { x: numbers.x, y: numbers.y, told };
          add(figure.scatter({ x: F("x"), y: F("y"), size: 6, fill_alpha: 0.75, line_alpha: 0, source, nonselection_alpha: 0.1 }), "point");
        } else if (chart.kind === "histogram") {
          const earlier = data.all.slice(0, k), bottom = numbers.y.map((_, i) => earlier.reduce((sum, each) => sum + each.y[i], 0));
          const told = [...numbers.y].map((v, i) => `${said(data.x[i], { ...chart.x, unit: "" })} to ${said(data.x[i + 1], chart.x)}: ${said(v, chart.y)} ${series.name}`);
          source.data = { left: data.x.slice(0, -1), right: data.x.slice(1), bottom, top: numbers.y.map((v, i) => v + bottom[i]), told };
          add(figure.quad({ left: F("left"), right: F("right"), bottom: F("bottom"), top: F("top"), source }), "bar");
        } else if (this.bars) {
          const n = chart.series.length, width = 0.8 / n, at = Float64Array.from(numbers.y, (_, i) => i - 0.4 + (k + 0.5) * width);
          const told = [...numbers.y].map((v, i) => `${chart.x.labels[i] ?? ""}: ${said(v, chart.y)}`);
          source.data = { at, y: numbers.y, told, ...(numbers.low && { low: numbers.low, high: numbers.high }) };
          const made = this.lying
            ? figure.hbar({ y: F("at"), right: F("y"), left: 0, height: 0.9 * width, source })
            : figure.vbar({ x: F("at"), top: F("y"), bottom: 0, width: 0.9 * width, source });
          add(made, "bar");
          if (numbers.low) {
            part.whisker = new Bokeh.Whisker({ base: F("at"), lower: F("low"), upper: F("high"), source, dimension: this.lying ? "width" : "height", level: "annotation" });
            figure.add_layout(part.whisker);
          }
        } else if (chart.kind === "heat") this.heat = GS.drawHeat(chart, figure, data);
        this.parts.push(part);
      });
      const name = (axis, labels) => {
        axis.ticker = new Bokeh.FixedTicker({ ticks: labels.map((_, k) => k), minor_ticks: [] });
        axis.major_label_overrides = new Map(labels.map((text, k) => [k, text]));
      };
      if (this.bars) name(this.lying ? figure.yaxis : figure.xaxis, chart.x.labels);
      else if (chart.x.labels.length) {
        name(figure.xaxis, chart.x.labels);
        figure.xaxes[0].major_label_orientation = 0.9;
      }
      const labels = chart.rows?.labels.length ? chart.rows.labels : chart.y.labels;
      if (labels) name(figure.yaxis, labels);
    }

    // Bars of some members within those of a histogram.
    markBars(counts) {
      const { data, figure } = this, columns = { left: data.x.slice(0, -1), right: data.x.slice(1), bottom: counts.map(() => 0), top: counts };
      if (!this.marked) {
        const source = new Bokeh.ColumnDataSource({ data: columns }), F = (field) => ({ field });
        this.marked = { source, glyph: figure.quad({ left: F("left"), right: F("right"), bottom: F("bottom"), top: F("top"), source, line_color: null }) };
      }
      this.marked.glyph.glyph.setv({ fill_color: GS.theme().roles.actual });
      this.marked.source.data = columns;
    }

    // Data and ranges of the part that is shown; `range` is that of the abscissa, null for all.
    fit(range = null) {
      const { chart, figure, data } = this, least = chart.y.span;
      if (this.bars) {
        const ends = extent(data.all.flatMap((each) => [each.y, each.low, each.high]));
        const values = airy(ends && [Math.min(0, ends[0]), Math.max(0, ends[1])], least, false);
        const names = [chart.x.labels.length - 0.4, -0.6];
        const [along, across] = this.lying ? [figure.y_range, figure.x_range] : [figure.x_range, figure.y_range];
        along.setv({ start: this.lying ? names[0] : names[1], end: this.lying ? names[1] : names[0] });
        across.setv({ start: ends && ends[0] >= 0 ? 0 : values[0], end: values[1] });
        return;
      }
      if (chart.kind === "heat") {
        const [x, y] = GS.heatRange(this, range, this.place());
        figure.x_range.setv({ start: x[0], end: x[1] });
        figure.y_range.setv(data.rows.length && chart.rows.labels.length ? { start: y[1], end: y[0] } : { start: y[0], end: y[1] });
        return;
      }
      const whole = this.whole(), [from, to] = range || whole;
      const width = Math.max(this.host.clientWidth - LEFT - RIGHT, 200), seen = [];
      for (const { series, numbers, source } of this.parts) {
        if (!this.isFunction) {
          if (!GS.isHidden(series)) seen.push(chart.kind === "histogram" ? source.data.top : numbers.y.filter((_, k) => numbers.x[k] >= from && numbers.x[k] <= to));
          continue;
        }
        const columns = ["y", "low", "high"].filter((name) => numbers[name]);
        const [x, ...values] = GS.reduced(numbers.x, columns.map((name) => numbers[name]), from, to, Math.ceil(width));
        source.data = { x, ...Object.fromEntries(columns.map((name, k) => [name, values[k]])) };
        const other = series.y && this.others.get(series.y.unit || "1");
        if (other) other.seen = [...other.seen ?? [], ...values]; else if (!GS.isHidden(series)) seen.push(...values);
      }
      this.setY(seen, least);
      for (const range of this.others.values()) {
        const [start, end] = airy(extent(range.seen ?? []), range.least, false);
        range.seen = [];
        range.setv({ start, end });
      }
      figure.x_range.setv({ start: from, end: to, reset_start: whole[0], reset_end: whole[1], bounds: whole });
      if (chart.x.scale === "log") logTicks(figure.xaxes[0], from, to);
      else {
        plain(figure.xaxes[0], from, to);
        if (!chart.x.labels.length) figure.xaxes[0].ticker.setv({ desired_num_ticks: Math.max(3, Math.min(6, Math.floor(width / 60))) });
      }
      this.turnTexts();
    }

    setY(seen, least) {
      const { chart, figure } = this, isLog = chart.y.scale === "log";
      let found = extent(isLog ? seen.map((values) => values.filter((v) => v > 0)) : seen);
      if (chart.kind === "histogram") found = [0, found ? found[1] : 1];
      if (found && !isLog && chart.kind !== "histogram") {
        // marks that are near enough to matter
        const near = Math.max(found[1] - found[0], NEAR * Math.max(Math.abs(found[0]), Math.abs(found[1])), least);
        const marks = chart.marks.filter((m) => !m.vertical).map((m) => m.value * chart.y.factor).filter((v) => v >= found[0] - near && v <= found[1] + near);
        found = [Math.min(found[0], ...marks), Math.max(found[1], ...marks)];
      }
      const ends = this.texts.flatMap((each) => each.ends);
      if (found && ends.length) found = [Math.min(found[0], ...ends), Math.max(found[1], ...ends)];
      let [start, end] = airy(found, least, isLog);
      // strips lie below all curves
      const room = STRIP * chart.strips.length;
      if (room && !isLog) start -= (end - start) * room / (1 - room);
      figure.y_range.setv(chart.kind === "histogram" ? { start: 0, end } : { start, end });
      if (isLog) logTicks(figure.yaxes[0], start, end); else plain(figure.yaxes[0], start, end);
    }

    // The whole range of the abscissa; time is that of the page.
    whole() {
      if (this.isTime) return [GS.state.start, GS.state.end];
      const isLog = this.chart.x.scale === "log", found = extent(this.parts.map(({ numbers }) => (this.chart.kind === "histogram" ? this.data.x : isLog ? numbers.x.filter((v) => v > 0) : numbers.x)));
      if (!found || this.isFunction || this.chart.kind === "histogram") return found && found[1] > found[0] ? found : airy(found, 1e-9, false);
      return airy(found, 1e-9, isLog);
    }

    // Colours and emphasis.
    dress() {
      const { figure, chart } = this, { ink, line, roles } = GS.theme();
      for (const axis of [...figure.xaxes, ...figure.yaxes]) {
        axis.setv({
          axis_label_text_color: ink, axis_label_text_font_style: "normal", axis_label_text_font_size: "12px", axis_label_text_font: FONT,
          major_label_text_color: ink, major_label_text_font_size: "12px", major_label_text_font: FONT, axis_label_standoff: 4,
          axis_line_color: ink, major_tick_line_color: line, minor_tick_line_color: null, major_tick_in: 0,
        });
      }
      for (const grid of [...figure.xgrids, ...figure.ygrids]) grid.grid_line_color = line;
      this.heat?.dress(GS.theme());
      if (this.heat?.bar) this.heat.bar.setv({ major_label_text_color: ink, title_text_color: ink, major_label_text_font: FONT, title_text_font: FONT });
      for (const { span, mark } of this.spans) span.setv({ line_color: roles[mark.role], line_dash: mark.dashes });
      const { paper } = GS.theme();
      for (const { span, line, text } of this.texts) {
        line.glyph.setv({ line_color: roles[span.role] });
        text.setv({ text_color: roles[span.role], background_fill_color: paper, background_fill_alpha: 0.8 });
      }
      for (const { strip, made } of this.bands || []) made.glyph.setv({ fill_color: roles[strip.role], line_color: roles[strip.role] });
      this.parts.forEach((part, k) => {
        if (chart.kind === "heat") return;
        const group = this.groups.find((each) => each.includes(k)), plain = GS.look(part.series);
        const look = group ? GS.striped(plain, group.indexOf(k), group.length) : plain, stands = GS.emphasis(part.series);
        const visible = !GS.isHidden(part.series), alpha = GS.alpha(part.series);
        for (const { made, kind } of part.glyphs) {
          made.visible = visible;
          if (kind === "line") {
            // what stands out is drawn whole
            const dashes = stands > 0 && group ? [] : look.dashes;
            made.glyph.setv({ line_color: look.colour, line_dash: dashes, line_dash_offset: look.offset || 0, line_width: look.width + (stands > 0 ? 1 : 0), line_alpha: stands > 0 ? 1 : alpha * (look.alpha ?? 1) });
            made.level = stands > 0 || part.series.role === "reference" ? "annotation" : "glyph";
          } else if (kind === "band") made.glyph.setv({ fill_color: look.colour, fill_alpha: (part.series.role === "band" ? 0.22 : 0.18) * alpha });
          else if (kind === "bar") made.glyph.setv({ fill_color: look.colour, line_color: null, fill_alpha: 0.85 * alpha });
          else for (const glyph of [made.glyph, made.nonselection_glyph, made.selection_glyph]) glyph?.setv?.({ fill_color: look.colour });
        }
        if (part.whisker) {
          part.whisker.setv({ line_color: ink });
          for (const head of [part.whisker.lower_head, part.whisker.upper_head]) head?.setv({ line_color: ink, size: 6 });
        }
      });
    }

    // Left end and width of the plotted part [px], for cursors and pointers.
    place() {
      const box = this.view?.frame.bbox;
      return box && box.width > 0 ? { left: box.left, top: box.top, width: box.width, height: box.height } : null;
    }

    // Texts of margins are left of the lower end, where a loop that falls leaves room.
    turnTexts() {
      if (!this.texts.length) return;
      const { start, end } = this.figure.x_range, along = this.chart.x.scale === "log" ? Math.log : (x) => x;
      const width = Math.max(this.host.clientWidth - LEFT - RIGHT, 1), pen = document.createElement("canvas").getContext("2d");
      pen.font = `12px ${FONT}`;
      for (const { text, span, x } of this.texts) {
        // a text that fits on neither side ends where the plot does
        const whole = pen.measureText(span.text).width + 10, share = Math.min(1, width / whole), needs = share * whole;
        const at = width * (along(x) - along(start)) / (along(end) - along(start));
        text.text_font_size = `${Math.floor(12 * share)}px`;
        text.setv(at > 0.35 * width ? { text_align: "right", x_offset: Math.max(-6, needs - at) } : { text_align: "left", x_offset: Math.min(6, width - needs - at) });
      }
    }

    // Saves the chart as drawn on the screen, by Bokeh's own tool.
    save() { this.saveTool.do.emit("save"); }

    // A drawing of the chart as SVG, made at once: for paper.
    drawing() {
      // colours of glyphs change a frame later, for which paper does not wait
      for (const { glyph, model, all_indices } of this.view.renderer_views.values()) glyph?.set_visuals(model.data_source, all_indices);
      const { width, height } = this.host.getBoundingClientRect(), svg = this.view.export("svg", false).canvas;
      svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
      svg.removeAttribute("width");
      svg.removeAttribute("height");
      return svg;
    }
  }

  GS.figure = async (chart, host) => new Figure(chart, host, await unpacked(chart)).show();
})();
