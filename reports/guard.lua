-- Refuses what no report of ours holds: an image that is not one of its figures, a link that leaves it, raw markup and
-- attributes. Text is escaped before it gets here, so this is the second lock.

local CLASSES = { summary = true, holds = true, missed = true, unnumbered = true }

local function refuse(what)
  io.stderr:write('the text holds ' .. what .. ', which is not of the report itself\n')
  os.exit(1)
end

local function plain(element)
  for name in pairs(element.attributes) do refuse('the attribute ' .. name) end
  for _, class in ipairs(element.classes) do
    if not CLASSES[class] then refuse('the class ' .. class) end
  end
end

local function raw(element) refuse('raw ' .. element.format) end

function Pandoc(doc)
  local figures = {}
  for _, label in ipairs(doc.meta.figures or {}) do
    figures['figures/' .. pandoc.utils.stringify(label):gsub('^#fig:', '') .. '.svg'] = true
  end
  local rules = {
    Image = function(image)
      if not figures[image.src] then refuse('the image ' .. image.src) end
      plain(image)
    end,
    Link = function(link)
      if link.target:sub(1, 1) ~= '#' then refuse('a link to ' .. link.target) end
      plain(link)
    end,
    RawInline = raw,
    RawBlock = raw,
    Span = plain,
    Div = plain,
    Header = plain,
    Code = plain,
    CodeBlock = plain,
  }
  doc:walk(rules)
  pandoc.Pandoc({ pandoc.Plain(doc.meta.title or {}), pandoc.Plain(doc.meta.question or {}) }):walk(rules)
  return nil
end
