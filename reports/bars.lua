-- Bars in pairs are brackets. TeX's '|x|' and '\|x\|' do not say which one opens, and the pages would set them as
-- relations, with space on either side. Bars that have their size given, or that come in odd numbers, are left alone.

local SIZED = { middle = true, big = true, Big = true, bigl = true, bigr = true, Bigl = true, Bigr = true }
-- The spellings that both of pandoc's writers set as brackets.
local BRACKETS = { ['|'] = { '\\left|', '\\right|' }, ['\\|'] = { '\\lVert ', '\\rVert ' } }

local function spelled(tex)
  tex = tex:gsub('\\left%s*\\|', '\\lVert '):gsub('\\right%s*\\|', '\\rVert ')
  tex = tex:gsub('\\left%s*\\lVert', '\\lVert'):gsub('\\right%s*\\rVert', '\\rVert')
  tex = tex:gsub('\\left%s*\\lvert%f[%A]', '\\left|'):gsub('\\right%s*\\rvert%f[%A]', '\\right|')
  return (tex:gsub('\\lvert%f[%A]', '\\left|'):gsub('\\rvert%f[%A]', '\\right|'))
end

local function bracketed(tex)
  local found, from = { ['|'] = {}, ['\\|'] = {} }, 1
  while true do
    local start, stop, bar = tex:find('(\\?|)', from)
    if not start then break end
    local command = tex:sub(1, start - 1):match('\\(%a+)%s*$')
    if not SIZED[command] and command ~= 'left' and command ~= 'right' then table.insert(found[bar], start) end
    from = stop + 1
  end
  local bracket = {}
  for bar, places in pairs(found) do
    for i, place in ipairs(#places % 2 == 0 and places or {}) do bracket[place] = BRACKETS[bar][2 - i % 2] end
  end
  return (tex:gsub('()\\?|', bracket))
end

function Math(math)
  if math.text:find('\\begin{array}', 1, true) then return nil end  -- its bars may be rules
  math.text = bracketed(spelled(math.text))
  return math
end
