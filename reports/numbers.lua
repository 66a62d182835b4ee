-- Makes one document of what differs between the two pages: numbers figures, tables and displayed equations,
-- fills empty links to them ('[](#fig:step)' becomes 'Figure 3'), and hands the opening summary to the template.

local TYPST = FORMAT == 'typst'
local counts = { Figure = 0, Table = 0, Equation = 0 }
local labels = {}
local sections = {}

local function fail(message)
  io.stderr:write(message .. '\n')
  os.exit(1)
end

-- The next number of its kind, remembered under the label that links use.
local function number(kind, label)
  counts[kind] = counts[kind] + 1
  local name = kind .. '\u{a0}' .. counts[kind]
  if label and label ~= '' then labels['#' .. label] = name end
  return name
end

-- The caption with its number in front.
local function numbered(caption, name)
  local first = caption[1]
  if not first then fail(name .. ' has no caption') end
  first.content:insert(1, pandoc.Space())
  first.content:insert(1, pandoc.Strong { pandoc.Str(name .. '.') })
  return caption
end

local function section(header)
  if header.classes:includes('unnumbered') then
    labels['#' .. header.identifier] = pandoc.utils.stringify(header)
    return
  end
  local level = header.level
  for deeper = level + 1, 6 do sections[deeper] = nil end
  sections[level] = (sections[level] or 0) + 1
  local parts = {}
  for l = 1, level do parts[l] = tostring(sections[l] or 0) end
  labels['#' .. header.identifier] = 'Section\u{a0}' .. table.concat(parts, '.')
end

local function figure(element)
  numbered(element.caption.long, number('Figure', element.identifier))
  return element
end

local function equation(math, label)
  if math.mathtype ~= 'DisplayMath' then return nil end
  number('Equation', label)
  if TYPST then return nil end
  local mark = pandoc.Span('(' .. counts.Equation .. ')', { class = 'number' })
  return pandoc.Span({ pandoc.Span(math, { class = 'formula' }), mark }, { id = label, class = 'equation' })
end

-- '[$$...$$]{#eq:plant}': a displayed equation with a label.
local function labelled(span)
  local math = #span.content == 1 and span.content[1]
  if math and math.t == 'Math' and math.mathtype == 'DisplayMath' then
    return equation(math, span.identifier) or span, false
  end
end

local WIDER = 0.4  -- of a letter, by which a capital is wider

-- Length in letters of what a cell shows, and of its longest word, which is not broken.
local function measure(cell)
  local shown = pandoc.utils.stringify(cell.contents):gsub('\\%a+', 'm'):gsub('[{}^$]', '')
  local longest = 0
  for word in shown:gsub('\u{200b}', ' '):gmatch('%S+') do
    local capitals = select(2, word:gsub('%u', ''))
    longest = math.max(longest, (utf8.len(word) or #word) + WIDER * math.max(capitals - 1, 0))
  end
  -- Bold capitals in a box are wider than letters.
  if shown:find('MISSED') then longest = math.max(longest, 13) end
  return utf8.len(shown) or #shown, longest
end

-- For each column the letters that it likes to have and the least that it can do with: its longest word, and some
-- more where there is prose. Headings are broken before cells are.
local function demands(element, least)
  local likes, needs = {}, {}
  local function rows(list, prose)
    for _, row in ipairs(list) do
      for i, cell in ipairs(row.cells) do
        local length, word = measure(cell)
        likes[i] = math.max(likes[i] or 0, length)
        needs[i] = math.max(needs[i] or 0, word, math.min(length, prose))
      end
    end
  end
  rows(element.head.rows, 0)
  for _, body in ipairs(element.bodies) do rows(body.body, least or 16) end
  return likes, needs
end

local function sum(list)
  local total = 0
  for _, value in ipairs(list) do total = total + value end
  return total
end

-- Words of a name can be as long as a line; in a table that is too wide they are parted where nobody sees it.
local function part_words(element)
  local function parted(str)
    local letters = {}
    for _, code in utf8.codes(str.text) do
      letters[#letters + 1] = utf8.char(code)
      if #letters % 7 == 6 then letters[#letters + 1] = '\u{200b}' end
    end
    return pandoc.Str(table.concat(letters))
  end
  local function wide(str) return utf8.len(str.text) > 12 and parted(str) or nil end
  return element:walk { Str = wide }
end

-- Sets the size of the letters and, where the table is wider than the page, the widths of its columns.
local fit
function fit(element, in_summary, parted)
  local LETTER, INSET = 0.5, 0.9  -- em, em per column
  local PAGE = in_summary and 431 or 453  -- pt: the summary's box has a margin within the text's width
  local likes, needs = demands(element, parted and 6)
  local columns = #element.colspecs
  for _, size in ipairs { 9, 8.5, 8, 7.5, 7, 6.5, 6 } do
    local room = (PAGE / size - INSET * columns) / LETTER
    if sum(needs) <= room then
      element.attributes['typst:text:size'] = size .. 'pt'
      if sum(likes) > room then
        local share = (room - sum(needs)) / (sum(likes) - sum(needs))
        for i, spec in ipairs(element.colspecs) do
          local letters = needs[i] + share * (likes[i] - needs[i])
          element.colspecs[i] = { spec[1], (letters * LETTER + INSET) * size / PAGE }
        end
      end
      return element
    end
  end
  if not parted then return fit(part_words(element), in_summary, true) end
  fail('a table of ' .. columns .. ' columns is too wide for the page: ' .. pandoc.utils.stringify(element.caption.long))
end

-- On a screen a wide table scrolls, so prose in it needs no more than a width to be read at.
local function ease(element)
  local likes = demands(element)
  for _, row in ipairs(element.head.rows) do
    for i, cell in ipairs(row.cells) do
      if likes[i] > 32 then cell.classes:insert('prose') end
    end
  end
end

local function scrolling(element)
  local caption = element.caption.long
  local id = element.identifier
  element.identifier, element.caption = '', pandoc.Caption()
  local out = pandoc.Blocks {}
  out:insert(pandoc.RawBlock('html', '<figure class="table"' .. (id ~= '' and ' id="' .. id .. '"' or '') .. '>'))
  if #caption > 0 then
    out:insert(pandoc.RawBlock('html', '<figcaption>'))
    out:extend(caption)
    out:insert(pandoc.RawBlock('html', '</figcaption>'))
  end
  out:insert(pandoc.Div({ element }, { class = 'scroll', tabindex = '0' }))
  out:insert(pandoc.RawBlock('html', '</figure>'))
  return out
end

local function tabled(element, in_summary)
  -- Widths guessed from the dashes of the source are never meant: columns are as wide as their content.
  element.colspecs = element.colspecs:map(function(spec) return { spec[1], nil } end)
  if not in_summary or #element.caption.long > 0 then
    numbered(element.caption.long, number('Table', element.identifier))
  end
  if TYPST then
    return fit(element, in_summary)
  end
  ease(element)
  return scrolling(element)
end

local function marked(span)
  if not TYPST then return nil end
  for _, class in ipairs { 'holds', 'missed' } do
    if span.classes:includes(class) then
      return { pandoc.RawInline('typst', '#' .. class .. '['), span, pandoc.RawInline('typst', ']') }
    end
  end
end

local function count(blocks, in_summary)
  return blocks:walk {
    traverse = 'topdown',
    Header = section,
    Figure = figure,
    Table = function(element) return tabled(element, in_summary), false end,
    Span = labelled,
    Math = function(math) return equation(math, ''), false end,
  }
end

local function linked(link)
  if #link.content > 0 or link.target:sub(1, 1) ~= '#' then return nil end
  local name = labels[link.target]
  if not name then fail('the text refers to ' .. link.target .. ', which is nowhere in the report') end
  link.content = { pandoc.Str(name) }
  return link
end

-- What Typst reads as more than its letters and pandoc does not escape everywhere: the marks of lists and headings,
-- dots in a row, and '-?', where a word may be parted.
local function literal(str)
  if not TYPST then return nil end
  local number = str.text:match('^(%d+)%.$')
  if number then return { pandoc.Str(number), pandoc.RawInline('typst', '\\.') } end
  if str.text:match('^[-+/]$') or str.text:match('^=+$') then
    return pandoc.RawInline('typst', (str.text:gsub('.', '\\%0')))
  end
  if not str.text:find('%-%?') and not str.text:find('..', 1, true) then return nil end
  local out, from = pandoc.Inlines {}, 1
  while true do
    local at = str.text:find('[-.][?.]', from)
    out:insert(pandoc.Str(str.text:sub(from, at)))
    if not at then return out end
    out:insert(pandoc.RawInline('typst', '\\'))
    from = at + 1
  end
end

-- A caption with a bracket too many leaves words where the figure should be.
local function check_figures(names)
  for _, name in ipairs(names) do
    local label = pandoc.utils.stringify(name)
    if not labels[label] then fail(label .. ' does not come out as a figure: see its caption and where it is placed') end
  end
end

function Pandoc(doc)
  local first = doc.blocks[1]
  if not (first and first.t == 'Div' and first.classes:includes('summary')) then
    fail("the template does not open with a '::: {.summary}' block that answers the question")
  end
  doc.blocks:remove(1)
  local summary = count(first.content, true)
  doc.blocks = count(doc.blocks, false)
  check_figures(doc.meta.figures or {})
  doc.meta.pagetitle = pandoc.MetaString(pandoc.utils.stringify(doc.meta.title))
  doc.meta.summary = pandoc.MetaBlocks(summary:walk { Link = linked, Span = marked, Str = literal })
  doc.blocks = doc.blocks:walk { Link = linked, Span = marked, Str = literal }
  doc.meta.title = pandoc.Inlines(doc.meta.title):walk { Str = literal }
  doc.meta.question = pandoc.Inlines(doc.meta.question):walk { Str = literal }
  return doc
end
