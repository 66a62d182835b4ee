"""How often is the diagnosis right when the effect is withheld?"""
